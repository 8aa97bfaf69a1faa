"""A test that hangs fails by name, the next one runs; one that hangs where no Python runs ends the session."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

CASES = """
import signal, threading, time, pytest

@pytest.fixture
def hanging():
    time.sleep(60)

def a_thread_of_its_own(done):
    done.wait(60)

def test_in_a_lock():
    done = threading.Event()
    thread = threading.Thread(target=a_thread_of_its_own, args=(done,), daemon=True)
    thread.start()
    thread.join()

def test_in_its_fixture(hanging): ...

def test_that_is_quick(): ...

def test_out_of_reach():
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    time.sleep(60)
"""


def run(tmp_path: Path, *options: str) -> subprocess.CompletedProcess[str]:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_hangs.py").write_text(CASES)
    command = [sys.executable, "-m", "pytest", "-v", "-rA", "-p", "no:cacheprovider", *options, "test_hangs.py"]
    limited = {**os.environ, "PLUMB_TEST_LIMIT_S": "1"}
    return subprocess.run(command, cwd=tmp_path, env=limited, capture_output=True, text=True, check=False, timeout=120)


def test_who_hangs_is_named_and_shown_and_nobody_waits(tmp_path: Path) -> None:
    done = run(tmp_path)
    assert "test_in_a_lock FAILED" in done.stdout and "test_in_its_fixture ERROR" in done.stdout
    assert "test_that_is_quick PASSED" in done.stdout
    assert "in a_thread_of_its_own" in done.stderr  # every thread
    assert "Timeout (0:00:02)!" in done.stderr and "in test_out_of_reach" in done.stderr
    assert done.returncode == 1


def test_a_worker_that_hangs_is_shown_and_replaced(tmp_path: Path) -> None:
    done = run(tmp_path, "-n", "1")
    for name in ("test_in_a_lock", "test_out_of_reach"):
        assert f"FAILED test_hangs.py::{name}" in done.stdout
    assert "ERROR test_hangs.py::test_in_its_fixture" in done.stdout
    assert "PASSED test_hangs.py::test_that_is_quick" in done.stdout
    assert "in a_thread_of_its_own" in done.stderr and "in test_out_of_reach" in done.stderr
    assert "3 failed" not in done.stdout and done.returncode == 1


def test_a_session_that_waits_between_two_tests_does_not_end(tmp_path: Path) -> None:
    """As a worker does that has nothing left: for longer than a test may hang."""
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    with (tmp_path / "conftest.py").open("a") as conftest:
        conftest.write("\n\ndef pytest_runtest_logfinish():\n    time.sleep(2.5)\n")
    (tmp_path / "test_quick.py").write_text("def test_one(): ...\n\ndef test_two(): ...\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "test_quick.py"]
    limited = {**os.environ, "PLUMB_TEST_LIMIT_S": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=limited, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0 and "2 passed" in done.stdout and not done.stderr, done.stdout + done.stderr

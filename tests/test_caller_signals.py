"""The tests are the same for a caller that ignores or blocks the signals which end plumb."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

CASE = """
import signal, subprocess, sys

def test_a_child_ends():
    for number in (signal.SIGINT, signal.SIGTERM):
        body = f"import os, time; os.kill(os.getpid(), {int(number)}); time.sleep(5)"
        ended = subprocess.run([sys.executable, "-c", body], stderr=subprocess.DEVNULL)
        assert ended.returncode == -number
"""
ENDING = (signal.SIGINT, signal.SIGTERM)


def ignore() -> None:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def block() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


@pytest.mark.parametrize("caller", [ignore, block])
def test_a_process_that_a_test_starts_can_be_ended(caller: Callable[[], None], tmp_path: Path) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_child.py").write_text(CASE)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_child.py"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, preexec_fn=caller)
    assert ended.returncode == 0, ended.stdout

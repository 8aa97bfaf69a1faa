"""Where PLUMB_NO_SKIPS=1, a test or a file that is skipped fails, and only what is written down may be skipped. What is
marked `long` is left out, and no skip, unless PLUMB_LONG=1."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CASES = {
    "test_body.py": "import pytest\ndef test_body(): pytest.skip('no compiler')\n",
    "test_mark.py": "import pytest\n@pytest.mark.skipif(True, reason='no board')\ndef test_mark(): ...\n",
    "test_fixture.py": (
        "import pytest\n@pytest.fixture\ndef tool(): pytest.skip('no tool')\ndef test_fixture(tool): ...\n"
    ),
    "test_file.py": "import pytest\npytest.importorskip('no_such_module')\ndef test_file(): ...\n",
    "test_expected.py": "import pytest\n@pytest.mark.xfail\ndef test_expected(): assert False\n",
    "test_allowed.py": "import pytest\ndef test_allowed(): pytest.skip('PLUMB_DATA is not set')\n",
}
FORBIDDEN = ["test_body.py", "test_mark.py", "test_fixture.py", "test_file.py"]


def run(
    folder: Path, *options: str, no_skips: str, cases: dict[str, str] = CASES, long: str = ""
) -> subprocess.CompletedProcess[str]:
    tests = folder / "tests"
    tests.mkdir()
    shutil.copy(Path(__file__).with_name("conftest.py"), tests)
    (folder / "pytest.ini").write_text("[pytest]\n")
    for name, text in cases.items():
        (tests / name).write_text(text)
    command = [sys.executable, "-m", "pytest", "-ra", "-p", "no:cacheprovider", "--continue-on-collection-errors"]
    command += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # an editable install's, reported too
    environment = {**os.environ, "PLUMB_NO_SKIPS": no_skips, "PLUMB_LONG": long}
    return subprocess.run(
        [*command, *options, "tests"], cwd=folder, env=environment, capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("workers", ["0", "1"])
def test_a_skip_that_nobody_wrote_down_is_a_failure_with_its_reason(tmp_path: Path, workers: str) -> None:
    done = run(tmp_path, "-n", workers, no_skips="1")
    assert done.returncode == 1 and "1 failed, 1 skipped, 1 xfailed, 3 errors" in done.stdout
    for name in FORBIDDEN:
        assert f"tests/{name}" in done.stdout
    assert done.stdout.count("MAY_SKIP in tests/conftest.py does not have it") >= len(FORBIDDEN)


def test_without_the_variable_a_skip_is_a_skip(tmp_path: Path) -> None:
    done = run(tmp_path, no_skips="")
    assert done.returncode == 0 and "5 skipped, 1 xfailed" in done.stdout


@pytest.mark.parametrize(("long", "said"), [("", "1 passed, 1 deselected"), ("1", "2 passed")])
def test_what_is_long_runs_when_asked_for(tmp_path: Path, long: str, said: str) -> None:
    text = "import pytest\n@pytest.mark.long\ndef test_long(): ...\ndef test_short(): ...\n"
    done = run(tmp_path, "-W", "ignore", no_skips="1", cases={"test_two.py": text}, long=long)
    assert done.returncode == 0 and said in done.stdout, done.stdout

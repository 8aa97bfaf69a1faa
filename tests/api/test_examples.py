"""Every program of examples/python prints what its last comment says."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((CHECKOUT / "examples" / "python").glob("*.py"))
IN_SLOW_TIME = "import runpy, sys; from support import slow_time; slow_time.begin(); runpy.run_path(sys.argv[1])"
PRINTS = "# Prints:\n"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_prints_what_it_says(path: Path, tmp_path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert 10 <= len(text.splitlines()) <= 50
    wanted = [line.removeprefix("#     ") for line in text.partition(PRINTS)[2].splitlines()]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT / "tests")}
    command = [sys.executable, "-c", IN_SLOW_TIME, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert wanted and done.stdout.splitlines() == wanted


def test_there_are_nine() -> None:
    assert len(EXAMPLES) == 9

"""The page of the core's choices and their alternatives has what the kernels cost today."""

from __future__ import annotations

import subprocess
import sys

import pytest

from plumb.checkout import CHECKOUT

pytest.importorskip("unicorn")


def test_the_page_has_the_cycles_and_errors_of_every_kernel() -> None:
    words = [sys.executable, str(CHECKOUT / "tools" / "gen_choices.py"), "--check", "--kernels"]
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "fresh\n"), ran.stdout + ran.stderr

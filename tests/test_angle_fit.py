"""The coefficients in angle.c are those of the fit, and a changed one is noticed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOL = ROOT / "tools" / "fit_angle.py"
SOURCE = ROOT / "firmware" / "core" / "angle.c"


def check(root: Path) -> int:
    tool = root / "tools" / "fit_angle.py"
    return subprocess.run([sys.executable, str(tool), "--check"], capture_output=True, timeout=240).returncode


def test_coefficients_are_the_fit() -> None:
    assert check(ROOT) == 0


def test_a_changed_coefficient_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "tools").mkdir()
    (tmp_path / "firmware" / "core").mkdir(parents=True)
    (tmp_path / "tools" / "fit_angle.py").write_bytes(TOOL.read_bytes())
    text = SOURCE.read_text()
    first = text.index("= {")
    digit = next(i for i in range(first, len(text)) if text[i] in "12345678")
    changed = text[:digit] + str(int(text[digit]) + 1) + text[digit + 1 :]
    (tmp_path / "firmware" / "core" / "angle.c").write_text(changed)
    assert check(tmp_path) == 1

"""The coefficients in angle.h and angle.c are those of the fit, and a changed one is noticed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOL = ROOT / "tools" / "fit_angle.py"
SOURCES = [ROOT / "firmware" / "core" / name for name in ("angle.h", "angle.c")]


def check(root: Path) -> int:
    tool = root / "tools" / "fit_angle.py"
    return subprocess.run([sys.executable, str(tool), "--check"], capture_output=True, timeout=240).returncode


def test_coefficients_are_the_fit() -> None:
    assert check(ROOT) == 0


@pytest.mark.parametrize("changed", SOURCES, ids=lambda path: path.name)
def test_a_changed_coefficient_is_noticed(tmp_path: Path, changed: Path) -> None:
    (tmp_path / "tools").mkdir()
    (tmp_path / "firmware" / "core").mkdir(parents=True)
    (tmp_path / "tools" / "fit_angle.py").write_bytes(TOOL.read_bytes())
    for source in SOURCES:
        text = source.read_text()
        if source == changed:
            first = text.index("= {")
            digit = next(i for i in range(first, len(text)) if text[i] in "12345678")
            text = text[:digit] + str(int(text[digit]) + 1) + text[digit + 1 :]
        (tmp_path / "firmware" / "core" / source.name).write_text(text)
    assert check(tmp_path) == 1

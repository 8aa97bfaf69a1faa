"""Images of fewer systems: each system alone, and all but one of them, builds, keeps the promises of every image and
equals its golden vectors."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from plumb.boards import open_board
from plumb.flash.call_graph import CallGraph
from plumb.flash.elf import Elf
from plumb.flash.left_out import saved_bytes
from plumb.proof import golden
from plumb.spec import declarations
from support.campaigns import LONG

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "tests/vectors"
NAMES = sorted(declarations.names())
ALONE = {f"{name} alone": [name] for name in NAMES}
WITHOUT = {f"without {name}": [other for other in NAMES if other != name] for name in NAMES}
SETS = ALONE | WITHOUT
CHOSEN = list(SETS) if LONG else [list(ALONE)[len(NAMES) // 2], list(WITHOUT)[-1]]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed"),
]


@pytest.mark.parametrize("which", CHOSEN)
def test_an_image_of_fewer_systems_is_one_that_can_be_shipped(tmp_path: Path, which: str) -> None:
    systems = SETS[which]
    options = [f"-DPLUMB_SYSTEMS={';'.join(systems)}", f"-DPython3_EXECUTABLE={sys.executable}"]
    configure = ["cmake", "--preset", "stm32f103", "-B", str(tmp_path), *options]
    for command in (configure, ["cmake", "--build", str(tmp_path), "--target", "firmware"]):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert "no soft float, library division, heap, recursion or pointer calls" in done.stdout
    if len(systems) > 1:  # what the full image says of leaving one out is less than what it saves
        full = CallGraph(ROOT / "build/stm32f103/firmware.elf")
        (left_out,) = set(NAMES) - set(systems)
        saved = full.elf.flash_bytes - Elf(tmp_path / "firmware.elf").flash_bytes
        assert 0 < saved_bytes(full, left_out) <= saved
    chosen = [case for case in golden.cases(VECTORS, systems) if case.entry.on_link]
    if not LONG:
        chosen = [next(case for case in chosen if case.entry.system == name) for name in systems]
    with open_board("virtual", image=tmp_path / "firmware.bin") as board:
        result = golden.check(board, VECTORS, chosen=chosen)
    assert result.verdict == "pass" and result.vectors >= len(systems), result.describe()

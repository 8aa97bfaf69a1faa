"""Images of fewer systems: each system alone, and all but one of them, builds, keeps the promises of every image and
equals its golden vectors."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from plumb.boards import open_board
from plumb.boards.virtual import VirtualBoard
from plumb.flash.call_graph import CallGraph
from plumb.flash.elf import Elf
from plumb.flash.left_out import saved_bytes
from plumb.link.identity import NackError
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
        stood_on = any(left_out in declarations.system(name).stands_on for name in systems)
        assert saved > 0 and (saved_bytes(full, left_out) > 0) is not stood_on
        assert saved_bytes(full, left_out) <= saved
    if not any(declarations.system(name).output for name in systems):
        moves_nothing(tmp_path / "firmware.bin")
    chosen = [case for case in golden.cases(VECTORS, systems) if case.entry.on_link]
    if not LONG:
        chosen = [next(case for case in chosen if case.entry.system == name) for name in systems]
    with open_board("virtual", image=tmp_path / "firmware.bin") as board:
        result = golden.check(board, VECTORS, chosen=chosen)
    assert result.verdict == "pass" and result.vectors >= len(systems), result.describe()


def moves_nothing(image: Path) -> None:
    """The pins of the speed controllers float, and arming is refused for this reason, not for the switch."""
    with VirtualBoard(image) as board:
        assert not any(board.machine.port(pin).is_output(int(pin[2:])) for pin in ("PB6", "PB7"))
        with pytest.raises(NackError, match="this system has nothing to move") as refused:
            board.session.arm(0.5)
        assert "arm switch" not in str(refused.value) and board.machine.warnings == []

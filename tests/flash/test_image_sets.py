"""Images of fewer systems: each system alone, and all but one of them, builds, keeps the promises of every image and
equals its golden vectors."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from plumb.boards import open_board
from plumb.boards.virtual import VirtualBoard
from plumb.flash.call_graph import CallGraph
from plumb.flash.elf import Elf
from plumb.flash.left_out import saved_bytes
from plumb.link.identity import NackError
from plumb.proof import golden
from plumb.spec import declarations, images
from support.campaigns import LONG

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "tests/vectors"
NAMES = sorted(images.images()[images.ALL].systems)
ALONE = {f"{name} alone": [name] for name in NAMES}
WITHOUT = {f"without {name}": [other for other in NAMES if other != name] for name in NAMES}
SETS = ALONE | WITHOUT
OF_BOTH = "build/image_of_one"
"""A folder of the sources: files that are generated in the build are called the same in both trees."""
CHOSEN = list(SETS) if LONG else [list(ALONE)[len(NAMES) // 2], list(WITHOUT)[-1]]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc is not installed"),
]


def built(source: Path, folder: Path, systems: Sequence[str]) -> str:
    """Build the image of these systems into the folder; what the build says."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("CMAKE")}
    clean["GIT_OPTIONAL_LOCKS"] = "0"  # a look at a copy does not renew the index
    options = [f"-DPLUMB_SYSTEMS={';'.join(systems)}", f"-DPython3_EXECUTABLE={sys.executable}"]
    configure = ["cmake", "--preset", "stm32f103", "-B", str(folder), *options]
    for command in (configure, ["cmake", "--build", str(folder), "--target", "firmware"]):
        done = subprocess.run(command, cwd=source, env=clean, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def moved(folder: Path) -> Path:
    """A copy of the sources, of the same commit."""
    for part in ("firmware", "tools", "host/plumb"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for part in ("CMakeLists.txt", "CMakePresets.json"):
        shutil.copy(ROOT / part, folder / part)
    ask = ["git", "-C", str(ROOT), "rev-parse", "--absolute-git-dir"]
    git = subprocess.run(ask, capture_output=True, text=True, check=False).stdout
    if git:
        (folder / ".git").write_text(f"gitdir: {git}")
    return folder


@pytest.mark.parametrize("which", CHOSEN)
def test_an_image_of_fewer_systems_is_one_that_can_be_shipped(tmp_path: Path, which: str) -> None:
    """And the first of them, built once more from a copy of the sources in a folder of another name, is the same three
    files: the options that decide are those of all, and the compiler refuses macros of date and time."""
    systems, first = SETS[which], which == CHOSEN[0]
    folder = ROOT / OF_BOTH if first else tmp_path
    if first:
        shutil.rmtree(folder, ignore_errors=True)
    said = built(ROOT, folder, systems)
    assert "no soft float, library division, heap, recursion or pointer calls" in said
    if first:
        copy = moved(tmp_path / "a/much/longer/name")
        built(copy, copy / OF_BOTH, systems)
        for kind in ("bin", "hex", "elf"):
            name = f"{OF_BOTH}/firmware.{kind}"
            assert (ROOT / name).read_bytes() == (copy / name).read_bytes()
        assert str(tmp_path).encode() not in (copy / OF_BOTH / "firmware.elf").read_bytes()
    if len(systems) > 1:  # what the full image says of leaving one out is less than what it saves
        full = CallGraph(ROOT / "build/stm32f103/firmware.elf")
        (left_out,) = set(NAMES) - set(systems)
        saved = full.elf.flash_bytes - Elf(folder / "firmware.elf").flash_bytes
        stood_on = any(left_out in declarations.system(name).stands_on for name in systems)
        assert saved > 0 and (saved_bytes(full, left_out) > 0) is not stood_on
        # a parameter that no system reads any more is a constant, with a range: some bytes come back
        assert saved_bytes(full, left_out) <= 1.05 * saved
    if not any(declarations.system(name).output for name in systems):
        moves_nothing(folder / "firmware.bin")
    chosen = [case for case in golden.cases(VECTORS, systems) if case.entry.on_link]
    if not LONG:
        chosen = [next(case for case in chosen if case.entry.system == name) for name in systems]
    with open_board("virtual", image=folder / "firmware.bin") as board:
        result = golden.check(board, VECTORS, chosen=chosen)
    assert result.verdict == "pass" and result.vectors >= len(systems), result.describe()


def moves_nothing(image: Path) -> None:
    """The pins of the speed controllers float, and arming is refused for this reason, not for the switch."""
    with VirtualBoard(image) as board:
        assert not any(board.machine.port(pin).is_output(int(pin[2:])) for pin in ("PB6", "PB7"))
        with pytest.raises(NackError, match="this system has nothing to move") as refused:
            board.session.arm(0.5)
        assert "arm switch" not in str(refused.value) and board.machine.warnings == []

"""Small programs for the simulated part, compiled on the spot: `board("uart")` is a machine that runs uart.c."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from support.f103_program import RunningProgram
from support.flash_image import image_path

HERE = Path(__file__).parent
COMPILER = "arm-none-eabi-gcc"
FLAGS = [
    *("-mcpu=cortex-m3", "-mthumb", "-std=c99", "-O2", "-g", "-Wall", "-Wextra", "-Werror"),
    *("-ffreestanding", "-nostdlib", "-nostartfiles", f"-I{HERE.parents[1] / 'firmware'}"),
    f"-I{HERE.parents[1] / 'firmware' / 'ports' / 'stm32f103'}",  # generated/pin_modes.h asks for a header of the port
    f"-I{HERE.parents[1] / 'build' / 'stm32f103' / 'systems'}",
]


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Name of a program here -> its ELF file, with .bin and .hex in the same folder; compiled once."""
    pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
    if shutil.which(COMPILER) is None:
        pytest.skip(f"{COMPILER} is not installed")
    folder = tmp_path_factory.mktemp("f103")
    done: dict[str, Path] = {}

    def build_one(name: str) -> Path:
        if name not in done:
            elf = folder / f"{name}.elf"
            sources = [str(HERE / f"{name}.c"), str(HERE / "start.c")]
            subprocess.run([COMPILER, *FLAGS, "-T", str(HERE / "part.ld"), *sources, "-o", str(elf)], check=True)
            for form, suffix in (("binary", ".bin"), ("ihex", ".hex")):
                command = ["arm-none-eabi-objcopy", "-O", form, str(elf), str(elf.with_suffix(suffix))]
                subprocess.run(command, check=True)
            done[name] = elf
        return done[name]

    return build_one


@pytest.fixture(scope="session")
def image() -> Path:
    """The flash image of the product."""
    return image_path()


@pytest.fixture
def board(build: Callable[[str], Path]) -> Callable[..., RunningProgram]:
    return lambda name, suffix=".bin", **options: RunningProgram(build(name).with_suffix(suffix), **options)

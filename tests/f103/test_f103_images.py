"""Images as they come: behind a boot loader, as .elf, .hex, .bin and .uf2, for every part and crystal."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from f103.conftest import COMPILER, FLAGS, HERE
from plumb.errors import UsageError
from plumb.f103 import SimulationError

FLASH_BASE = 0x08000000


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Path]:
    """Offset -> the ELF file of hello.c linked behind a boot loader of that size, with .bin, .hex and .uf2."""
    done: dict[int, Path] = {}

    def link(offset: int) -> Path:
        if offset not in done:
            folder = tmp_path_factory.mktemp("moved")
            script = (
                (HERE / "part.ld").read_text().replace("ORIGIN = 0x08000000", f"ORIGIN = 0x{FLASH_BASE + offset:X}")
            )
            (folder / "part.ld").write_text(script)
            elf = folder / "hello.elf"
            sources = [str(HERE / "hello.c"), str(HERE / "start.c")]
            subprocess.run([COMPILER, *FLAGS, "-T", str(folder / "part.ld"), *sources, "-o", str(elf)], check=True)
            for form, suffix in (("binary", ".bin"), ("ihex", ".hex")):
                command = ["arm-none-eabi-objcopy", "-O", form, str(elf), str(elf.with_suffix(suffix))]
                subprocess.run(command, check=True)
            elf.with_suffix(".uf2").write_bytes(uf2(elf.with_suffix(".bin").read_bytes(), FLASH_BASE + offset))
            done[offset] = elf
        return done[offset]

    return link


def uf2(data: bytes, address: int, family: int = 0x5EE21072) -> bytes:
    """Blocks of 256 bytes each."""
    pieces = [data[i : i + 256] for i in range(0, len(data), 256)]
    blocks = bytearray()
    for i, piece in enumerate(pieces):
        head = struct.pack("<8I", 0x0A324655, 0x9E5D5157, 0x2000, address + 256 * i, len(piece), i, len(pieces), family)
        blocks += head + piece.ljust(476, b"\0") + struct.pack("<I", 0x0AB16F30)
    return bytes(blocks)


def says_hello(image: Path | bytes, **options: object) -> bool:
    from plumb.f103 import Machine

    machine = Machine(image, **options)  # type: ignore[arg-type]
    machine.uart.baudrate = 921600
    machine.advance_us(20_000)
    return machine.uart.read(100) == b"hello\n"


@pytest.mark.parametrize("offset", [0, 0x1000, 0x2000, 0x5000])
@pytest.mark.parametrize("suffix", [".elf", ".hex", ".uf2", ".bin"])
def test_a_program_boots_where_it_was_linked(moved: Callable[[int], Path], offset: int, suffix: str) -> None:
    """A small .bin may belong to more than one offset: then it wants to be told."""
    image = moved(offset).with_suffix(suffix)
    assert says_hello(image, offset=offset if suffix == ".bin" else None)


def test_the_vectors_of_a_bin_tell_its_offset(moved: Callable[[int], Path]) -> None:
    from plumb.f103 import Machine

    image = moved(0x2000).with_suffix(".bin")
    machine = Machine(image)
    assert machine.table == 0x2000
    assert says_hello(image)


def test_content_decides_and_not_the_name(moved: Callable[[int], Path], tmp_path: Path) -> None:
    for suffix in (".elf", ".hex", ".uf2"):
        renamed = tmp_path / f"{suffix[1:]}.bin"
        renamed.write_bytes(moved(0x2000).with_suffix(suffix).read_bytes())
        assert says_hello(renamed)


def test_a_wrong_offset_is_refused(moved: Callable[[int], Path]) -> None:
    for offset, why in (
        (0x4000, "for offset 0x4000"),
        (0x1001, "no multiple"),
        (-0x100, "offset -256 is not in the flash"),
        (10**9, "not in the flash"),
    ):
        with pytest.raises(UsageError, match=why):
            says_hello(moved(0).with_suffix(".bin"), offset=offset)
    with pytest.raises(UsageError, match="no vector table at 0x08001000"):
        says_hello(moved(0x2000), offset=0x1000)


def test_a_uf2_of_another_family_or_cut_off_is_refused(moved: Callable[[int], Path], tmp_path: Path) -> None:
    data = moved(0).with_suffix(".bin").read_bytes()
    other = tmp_path / "other.uf2"
    other.write_bytes(uf2(data, FLASH_BASE, family=0x57755A57))
    with pytest.raises(UsageError, match="holds nothing to flash"):
        says_hello(other)
    other.write_bytes(uf2(data, FLASH_BASE)[:-1])
    with pytest.raises(UsageError, match="not a valid block of UF2"):
        says_hello(other)


@pytest.mark.parametrize("crystal_mhz", [8, 12, 16])
def test_clocks_follow_the_crystal(build: Callable[[str], Path], crystal_mhz: int) -> None:
    """hello.c asks for nine times the crystal, which is 72 MHz at 8 MHz alone."""
    from plumb.f103 import Machine

    machine = Machine(build("hello"), crystal_mhz=crystal_mhz)
    if crystal_mhz > 8:
        with pytest.raises(SimulationError, match=f"{9 * crystal_mhz} MHz; 72 MHz is the limit"):
            machine.advance_us(20_000)
        return
    machine.advance_us(20_000)
    assert machine.rcc.hclk_ticks * 72 == 40320


def test_a_crystal_that_is_not_modelled_is_refused(build: Callable[[str], Path]) -> None:
    with pytest.raises(UsageError, match="a crystal of 7 MHz"):
        says_hello(build("hello"), crystal_mhz=7)


@pytest.mark.parametrize(
    ("part", "flash_kib", "ram_kib"),
    [
        ("stm32f103c4", 16, 6),
        ("STM32F103R6", 32, 10),
        ("stm32f103c8t6", 64, 20),
        ("stm32f103vb", 128, 20),
        ("stm32f103rd", 384, 64),
        ("stm32f103ze", 512, 64),
    ],
)
def test_every_part_of_the_family_boots(build: Callable[[str], Path], part: str, flash_kib: int, ram_kib: int) -> None:
    from plumb.f103 import Machine

    machine = Machine(moved_stack(build("hello").with_suffix(".bin"), ram_kib), part)
    assert (len(machine.cpu.flash), len(machine.cpu.ram)) == (flash_kib << 10, ram_kib << 10)
    machine.uart.baudrate = 921600
    machine.advance_us(20_000)
    assert machine.uart.read(100) == b"hello\n"


def moved_stack(image: Path, ram_kib: int) -> bytes:
    """The image with its stack at the end of that RAM."""
    return struct.pack("<I", 0x20000000 + ram_kib * 1024) + image.read_bytes()[4:]


def test_a_name_that_is_no_part_is_refused(build: Callable[[str], Path]) -> None:
    for name in ("stm32f103ca", "stm32f103z4", "stm32f104c8", "c8"):
        with pytest.raises(UsageError, match=f"'{name}' is not a simulated part"):
            says_hello(build("hello"), part=name)


def test_a_small_part_lacks_what_its_datasheet_says(build: Callable[[str], Path]) -> None:
    from plumb.f103 import Machine

    machine = Machine(moved_stack(build("pwm").with_suffix(".bin"), 6), "stm32f103c4")
    with pytest.raises(SimulationError, match="TIM4, which a stm32f103c4 does not have"):
        machine.advance_us(20_000)

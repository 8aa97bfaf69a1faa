"""The program that a machine boots: its bytes in flash, and where its vector table is.

A file with addresses (.elf, .hex, .uf2) says where it belongs. Plain bytes (.bin) belong to the beginning of the flash,
unless their vectors say that a boot loader stands before them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb.errors import UsageError
from plumb.flash.image import FLASH_BASE, FLASH_BYTES, has_addresses, read_flash

OFFSETS = (0x800, 0x1000, 0x2000, 0x3000, 0x4000, 0x5000, 0x7000, 0x8000, 0xC000, 0x10000)
"""Sizes of boot loaders for this part that are in use: where the vector table of a .bin may belong."""
TABLE_STEP = 0x100
"""Vector tables begin at multiples of this (Armv7-M B3.2.5, 76 vectors need 512 bytes; boot loaders keep to more)."""
CORE_VECTORS = 16
LARGEST_RAM = 0x18000
FIRST_HALFWORDS = (
    *((0xF800, 0x4800), (0xFE00, 0xB400), (0xFFFF, 0xE7FE), (0xFFFF, 0xE92D), (0xFFFF, 0xF8DF), (0xFFFF, 0x4770)),
    *((0xFFFF, 0xBF00), (0xFF00, 0xBE00), (0xF800, 0x2000), (0xF800, 0xE000), (0xFF80, 0xB080), (0xF800, 0xF000)),
    *((0xFF00, 0xF300), (0xFF00, 0x4600)),
)
"""Mask and value of what a handler begins with: ldr literal, push, b to itself, push.w, ldr.w, bx lr, nop, bkpt, movs,
b, sub sp, bl or movw, mrs, mov. One halfword in seven of other contents is among them."""
SURE = 0.5


@dataclass(frozen=True)
class Program:
    """data: bytes of the flash from its beginning on. table: offset of the vector table."""

    data: bytes
    table: int


def load_program(image: bytes | Path, offset: int | None = None) -> Program:
    """The program of a file, or of bytes. offset: of the program in flash; without it found by its vectors.

    Raises UsageError for what is no program, and for plain bytes that may belong to more than one place.
    """
    name = str(image) if isinstance(image, Path) else "the image"
    data = read_flash(image) if isinstance(image, Path) else image
    if offset is not None and not 0 <= offset < FLASH_BYTES:
        raise UsageError(f"offset {offset} is not in the flash: give 0 to {FLASH_BYTES - TABLE_STEP} bytes")
    if offset is not None and offset % TABLE_STEP:
        raise UsageError(f"offset 0x{offset:X} is no multiple of 0x{TABLE_STEP:X}, as a vector table wants")
    if isinstance(image, Path) and has_addresses(image):
        return Program(data, _table_in(data, offset, name))
    if offset is None:
        offset = _offset_of(data, name)
    elif not _fits(data, offset):
        raise UsageError(f"{name} does not begin with a vector table for offset 0x{offset:X}")
    return Program(b"\xff" * offset + data, offset)


def _table_in(data: bytes, offset: int | None, name: str) -> int:
    """Where the vector table is, in bytes that stand where they belong: at the offset, or first in the flash."""
    first = next((i for i, byte in enumerate(data) if byte != 0xFF), 0)
    table = first if offset is None else offset
    if not _fits(data[table:], table):
        raise UsageError(
            f"{name} is not an image for the STM32F103: it has no vector table at 0x{FLASH_BASE + table:08X}"
        )
    return table


def _offset_of(data: bytes, name: str) -> int:
    """The offset at which most handlers begin like one; 0 where half of them do."""
    fitting = {offset: _share(data, offset) for offset in (0, *OFFSETS) if _fits(data, offset)}
    if not fitting:
        raise UsageError(f"{name} is not an image for the STM32F103: it does not begin with a vector table")
    best = [offset for offset, share in fitting.items() if share == max(fitting.values())]
    if len(best) > 1 and 0 not in best:
        places = " and ".join(f"0x{offset:X}" for offset in best)
        raise UsageError(
            f"{name} belongs behind a boot loader, whose size its vectors do not tell: {places} fit; say which"
        )
    return best[0]


def _vectors(data: bytes) -> Sequence[int]:
    """Stack and handlers of the core's vectors."""
    return struct.unpack_from(f"<{CORE_VECTORS}I", data.ljust(4 * CORE_VECTORS, b"\0"))


def _fits(data: bytes, offset: int) -> bool:
    """True when the bytes, put at this offset, begin with a stack in RAM and a reset handler behind the table."""
    stack, entry = _vectors(data)[:2]
    begin = FLASH_BASE + offset
    return 0x20000000 < stack <= 0x20000000 + LARGEST_RAM and entry & 1 == 1 and begin + 8 <= entry < begin + len(data)


def _share(data: bytes, offset: int) -> float:
    """Share of the handlers, if the bytes were at this offset, that lie in them and begin as handlers do."""
    handlers = {vector for vector in _vectors(data)[1:] if vector}
    good = 0
    for vector in handlers:
        place = vector - 1 - FLASH_BASE - offset
        if vector & 1 and 8 <= place <= len(data) - 2:
            half = int.from_bytes(data[place : place + 2], "little")
            good += any(half & mask == value for mask, value in FIRST_HALFWORDS)
    return good / len(handlers)

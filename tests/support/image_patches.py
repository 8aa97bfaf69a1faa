"""The flash image with machine code of the test's own in it, its CRC right all the same."""

from __future__ import annotations

import struct
import zlib

from plumb.flash.elf import Elf

FLASH = 0x08000000
RETURN_TRUE = struct.pack("<2H", 0x2001, 0x4770)


def patched(image: bytes, elf: Elf, function: str, code: bytes) -> bytes:
    """The image with `code` at the beginning of `function`."""
    at = elf.symbol(function).address - FLASH
    changed = image[:at] + code + image[at + len(code) : -4]
    return changed + struct.pack("<I", zlib.crc32(changed))


def without_memory_check(image: bytes, elf: Elf) -> bytes:
    """Finds all guarded memory intact: what stands behind the check is seen alone."""
    return patched(image, elf, "board_memory_intact", RETURN_TRUE)

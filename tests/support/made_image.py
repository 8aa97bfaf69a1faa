"""Images made to measure, for tools that read nothing but the header and the checksum."""

from __future__ import annotations

import struct
import zlib

from plumb.flash.image import FLASH_BASE as FLASH


def made_image(size: int, family: int = 0x103, magic: bytes = b"plmb", claims: int = 0) -> bytes:
    """An image that says the right things about itself and does nothing. claims: a length other than its own."""
    body = bytearray(i * 7 & 0xFF for i in range(size - 4))
    struct.pack_into("<II", body, 0, 0x20002000, FLASH + 0x41)
    struct.pack_into("<4s7I", body, 0x130, magic, family, claims or size, 0x12345678, 0x9ABCDEF0, 0, 0, 0)
    return bytes(body) + struct.pack("<I", zlib.crc32(body))

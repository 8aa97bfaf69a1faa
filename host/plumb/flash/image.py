"""The flash image: finds it, and reads its bytes from .bin, .hex, .elf or .uf2, by their content. The files of one
build give the same bytes."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from plumb.errors import UsageError
from plumb.files.input_files import read_bytes

FLASH_BASE = 0x08000000
FLASH_BYTES = 0x80000
"""Flash of the largest supported part of the family."""
MOST_HEX_BYTES = 16 * FLASH_BYTES
"""Largest file of Intel HEX: a record of one byte takes 13."""
MOST_BYTES = 64 << 20
"""Largest file of an image: an ELF file contains debug information, too."""
PARAMETER_SLOTS = 0x0800F000
"""Start of the parameter slots, which take the flash of the smallest part from here to its end."""
FAMILY = 0x103
HEADER_OFFSET = 0x130
HEADER_MAGIC = 0x626D6C70
HEADER = struct.Struct("<6I")
"""Image header, after the vector table: magic, family, size of the image, commit (two words), 1 if the tree differed.
firmware/ports/stm32f103/startup.c places it; the image's last word is the CRC-32 of all bytes before it."""
_ELF_MAGIC, _ELF_ARM, _PT_LOAD = b"\x7fELF", 40, 1
_UF2_MAGIC, _UF2_END = b"UF2\n\x57\x51\x5d\x9e", b"\x30\x6f\xb1\x0a"
_UF2_BLOCK, _UF2_FAMILY, _UF2_NOT_FLASH = 512, 0x5EE21072, 1
"""Size of a block of UF2 (github.com/microsoft/uf2), the family of the STM32F1, the flag of what is not for flash."""


@dataclass(frozen=True)
class ImageHeader:
    """Header of an image. git_hash: first 16 digits of its commit, '' when unknown."""

    family: int
    size: int
    git_hash: str
    git_dirty: bool


def find_image(image: Path | None = None) -> Path:
    """The flash image to use: `image`, a file or the name of an image; without it the image of all systems. Raises
    UsageError when there is none (`plumb.flash.named_images`)."""
    if image is not None and image.is_file():
        return image
    # names of images are of systems, which the simulated chip does not know
    from plumb.flash.named_images import named_image

    return named_image(None if image is None else str(image))


def load_image(path: Path) -> bytes:
    """Bytes from 0x08000000 on; gaps read as erased flash. Raises UsageError for a file that is not an image."""
    data = read_flash(path)
    check_image(data, str(path))
    return data


def read_flash(path: Path) -> bytes:
    """As `load_image`, of a file that need not begin with a vector table."""
    raw = read_bytes(path, MOST_BYTES, "build an image with 'make image'")
    reader = _reader(raw[:4], path)
    return raw if reader is None else reader(raw, path)


def has_addresses(path: Path) -> bool:
    """True for a file that says where its bytes belong. Raises UsageError for one that cannot be read."""
    return _reader(read_bytes(path, MOST_BYTES, "give another image")[:4], path) is not None


def _reader(begin: bytes, path: Path) -> Callable[[bytes, Path], bytes] | None:
    """What reads a file that begins with these bytes; None for plain bytes."""
    if begin == _ELF_MAGIC:
        return _from_elf
    if begin == _UF2_MAGIC[:4]:
        return _from_uf2
    return _from_hex if begin[:1] == b":" or path.suffix.lower() in (".hex", ".ihx") else None


def load_own_image(path: Path) -> bytes:
    """Bytes of an image to be run. An image of plumb is checked whole, any other by its vector table. Raises
    UsageError."""
    data = load_image(path)
    if claims_to_be_ours(data):
        own_header(data, str(path))
    return data


def check_image(data: bytes, name: str) -> None:
    """Raises UsageError unless the data begin with a vector table whose stack is in RAM and whose entry is in flash."""
    if len(data) >= 8:
        stack, entry = struct.unpack_from("<II", data)
        if 0x20000000 < stack <= 0x20018000 and entry & 1 and FLASH_BASE <= entry < FLASH_BASE + len(data):
            return
    raise UsageError(f"{name} is not an image for the STM32F103: it does not begin with a vector table")


def claims_to_be_ours(data: bytes) -> bool:
    """True when the data have plumb's image header, valid or not."""
    return len(data) >= HEADER_OFFSET + 32 and struct.unpack_from("<I", data, HEADER_OFFSET)[0] == HEADER_MAGIC


def own_header(data: bytes, name: str) -> ImageHeader:
    """The header of a plumb image. Raises UsageError unless the image is undamaged, for this family, and ends before
    the parameter slots."""
    if not claims_to_be_ours(data):
        raise UsageError(f"{name} is not a plumb image: it has no image header; build one with 'make image'")
    _, family, size, hash_high, hash_low, dirty = HEADER.unpack_from(data, HEADER_OFFSET)
    if family != FAMILY:
        raise UsageError(f"{name} is for another part (family {family:x}, not {FAMILY:x}); build one with 'make image'")
    if size != len(data) or struct.unpack("<I", data[-4:])[0] != zlib.crc32(data[:-4]):
        raise UsageError(f"{name} is damaged: its length or checksum is wrong; build it again with 'make image'")
    if FLASH_BASE + size > PARAMETER_SLOTS:
        raise UsageError(
            f"{name} is too long: its {size} bytes reach into the parameters at 0x{PARAMETER_SLOTS:08x}; "
            "build a smaller one"
        )
    git_hash = f"{hash_high:08x}{hash_low:08x}" if hash_high or hash_low else ""
    return ImageHeader(family, size, git_hash, bool(dirty))


def _place(pieces: list[tuple[int, bytes]], path: Path) -> bytes:
    if not pieces:
        raise UsageError(f"{path} holds nothing to flash")
    end = max(address + len(data) for address, data in pieces)
    if min(address for address, _ in pieces) < FLASH_BASE or end > FLASH_BASE + FLASH_BYTES:
        raise UsageError(f"{path} has data outside the flash of an STM32F103")
    image = bytearray(b"\xff" * (end - FLASH_BASE))
    for address, data in pieces:
        image[address - FLASH_BASE : address - FLASH_BASE + len(data)] = data
    return bytes(image)


def _from_elf(raw: bytes, path: Path) -> bytes:
    """The loadable segments at their physical addresses."""
    try:
        machine = struct.unpack_from("<H", raw, 18)[0]
        if raw[4:6] != b"\x01\x01" or machine != _ELF_ARM:
            raise UsageError(f"{path} is not a 32-bit Arm program")
        table, size, count = struct.unpack_from("<I", raw, 28)[0], *struct.unpack_from("<HH", raw, 42)
        pieces, left = [], FLASH_BYTES
        for i in range(count):
            kind, offset, _virtual, physical, length = struct.unpack_from("<5I", raw, table + i * size)
            if kind == _PT_LOAD and length:
                left -= length
                if left < 0:
                    raise UsageError(f"{path} loads more than the {FLASH_BYTES} bytes of the largest STM32F103")
                pieces.append((physical, raw[offset : offset + length]))
    except struct.error as error:
        raise UsageError(f"{path} is a damaged ELF file") from error
    return _place(pieces, path)


def _from_uf2(raw: bytes, path: Path) -> bytes:
    """Blocks of 512 bytes, each with its address and at most 476 bytes; those for other families are left out."""
    pieces: list[tuple[int, bytes]] = []
    for number in range(0, len(raw), _UF2_BLOCK):
        block = raw[number : number + _UF2_BLOCK]
        if len(block) < _UF2_BLOCK or block[:8] != _UF2_MAGIC or block[-4:] != _UF2_END:
            raise UsageError(f"{path} block {number // _UF2_BLOCK + 1} is not a valid block of UF2")
        flags, address, length, _, _, family = struct.unpack_from("<6I", block, 8)
        if length > 476:
            raise UsageError(f"{path} block {number // _UF2_BLOCK + 1} is not a valid block of UF2")
        if not flags & _UF2_NOT_FLASH and (not flags & 0x2000 or family == _UF2_FAMILY):
            pieces.append((address, block[32 : 32 + length]))
    return _place(pieces, path)


def _from_hex(raw: bytes, path: Path) -> bytes:
    """Intel HEX: data, end, and both kinds of extended address."""
    if len(raw) > MOST_HEX_BYTES:
        raise UsageError(f"{path} has more records than the flash of an STM32F103 has bytes")
    pieces: list[tuple[int, bytes]] = []
    upper = 0
    for number, line in enumerate(raw.split(), 1):
        try:
            record = bytes.fromhex(line[1:].decode("ascii"))
        except ValueError:
            record = b""
        if line[:1] != b":" or len(record) < 5 or len(record) != record[0] + 5 or sum(record) & 0xFF:
            raise UsageError(f"{path} line {number} is not a valid Intel HEX record")
        address, kind, data = int.from_bytes(record[1:3], "big"), record[3], record[4:-1]
        if kind == 0:
            pieces.append((upper + address, data))
        elif kind == 1:
            break
        elif kind in (2, 4):
            upper = int.from_bytes(data, "big") << (16 if kind == 4 else 4)
    return _place(pieces, path)

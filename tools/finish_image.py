"""Turns the linked firmware.elf into what gets flashed: checksum in its last word, firmware.bin, firmware.hex.

usage: finish_image.py firmware.elf [--flash BYTES] [--ram BYTES]

The image header (firmware/stm32f103/startup.c) says how long the image is; its last word becomes the CRC-32 of all
bytes before it, in the ELF file as well, so that a debugger loads the very same bytes. Prints the memory table.
Same ELF, same output, to the byte. Exit code 1 when the file is not such an image, or over its budget.
"""

from __future__ import annotations

import argparse
import struct
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path

FLASH_START = 0x08000000
RAM_START = 0x20000000
HEADER_OFFSET = 0x130
HEADER_MAGIC = 0x626D6C70
SHF_ALLOC = 2
SHT_NOBITS = 8
PT_LOAD = 1


@dataclass(frozen=True)
class Segment:
    """A piece of the file that is loaded: its place in the file, its address in flash, its bytes."""

    offset: int
    address: int
    size: int


@dataclass(frozen=True)
class Section:
    name: str
    address: int
    size: int
    in_file: bool


def load_segments(elf: bytes) -> list[Segment]:
    """Loadable segments with content, in order of address. Raises ValueError when this is not a 32-bit ARM ELF."""
    if elf[:6] != b"\x7fELF\x01\x01" or struct.unpack_from("<H", elf, 18)[0] != 40:
        raise ValueError("it is not a little-endian 32-bit Arm ELF file")
    table, count, size = _table(elf, 28, 42)
    segments = []
    for index in range(count):
        kind, offset, _, address, file_size = struct.unpack_from("<5I", elf, table + index * size)
        if kind == PT_LOAD and file_size > 0:
            segments.append(Segment(offset, address, file_size))
    return sorted(segments, key=lambda segment: segment.address)


def load_sections(elf: bytes) -> list[Section]:
    """Sections that occupy memory, in order of address."""
    table, count, size = _table(elf, 32, 46)
    headers = [struct.unpack_from("<6I", elf, table + index * size) for index in range(count)]
    names = headers[struct.unpack_from("<H", elf, 50)[0]][4]
    sections = []
    for name, kind, flags, address, _, length in headers:
        if flags & SHF_ALLOC and length > 0:
            start = names + name
            text = elf[start : elf.index(b"\0", start)].decode()
            sections.append(Section(text, address, length, kind != SHT_NOBITS))
    return sorted(sections, key=lambda section: section.address)


def _table(elf: bytes, offset_at: int, size_at: int) -> tuple[int, int, int]:
    """Offset, entries and bytes per entry of one of the ELF file's two tables."""
    size, count = struct.unpack_from("<2H", elf, size_at)
    return int(struct.unpack_from("<I", elf, offset_at)[0]), int(count), int(size)


def finish(elf: bytearray) -> bytes:
    """Writes the checksum into `elf` and returns the flat image that starts at FLASH_START."""
    segments = load_segments(bytes(elf))
    end = max(segment.address + segment.size for segment in segments)
    image = bytearray(b"\xff" * (end - FLASH_START))
    for segment in segments:
        start = segment.address - FLASH_START
        if start < 0:
            raise ValueError(f"it has content for address 0x{segment.address:08x}, which is not in flash")
        image[start : start + segment.size] = elf[segment.offset : segment.offset + segment.size]
    magic, _, size = struct.unpack_from("<3I", image, HEADER_OFFSET)
    if magic != HEADER_MAGIC or size != len(image):
        raise ValueError("its image header is missing or does not give its length")
    checksum = struct.pack("<I", zlib.crc32(image[:-4]))
    image[-4:] = checksum
    last = segments[-1]
    elf[last.offset + last.size - 4 : last.offset + last.size] = checksum
    return bytes(image)


def intel_hex(image: bytes) -> str:
    """The image as Intel HEX, 16 bytes a line."""

    def record(kind: int, address: int, data: bytes) -> str:
        body = struct.pack(">BHB", len(data), address, kind) + data
        return f":{body.hex()}{-sum(body) & 0xFF:02x}".upper()

    lines = []
    for start in range(0, len(image), 16):
        address = FLASH_START + start
        if start % 0x10000 == 0:
            lines.append(record(4, 0, struct.pack(">H", address >> 16)))
        lines.append(record(0, address & 0xFFFF, image[start : start + 16]))
    lines.append(record(1, 0, b""))
    return "\n".join(lines) + "\n"


def memory_table(elf: bytes, image: bytes, flash: int, ram: int) -> tuple[str, bool]:
    """What lies where, as text; and whether it fits its budget."""
    lines = []
    used_ram = 0
    for section in load_sections(elf):
        lines.append(f"  {section.name:<14} {section.size:>6} bytes at 0x{section.address:08x}")
        if section.address >= RAM_START:
            used_ram += section.size
    lines.append(f"  flash {len(image)} of {flash} bytes, RAM with stack {used_ram} of {ram} bytes")
    return "\n".join(lines), len(image) <= flash and used_ram <= ram


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("elf", type=Path)
    parser.add_argument("--flash", type=int, default=32 * 1024, help="budget in bytes")
    parser.add_argument("--ram", type=int, default=8 * 1024, help="budget in bytes, stack included")
    arguments = parser.parse_args()
    path: Path = arguments.elf
    elf = bytearray(path.read_bytes())
    try:
        image = finish(elf)
    except (ValueError, struct.error) as error:
        print(f"{path.name} cannot be made into an image: {error}", file=sys.stderr)
        return 1
    path.write_bytes(elf)
    path.with_suffix(".bin").write_bytes(image)
    path.with_suffix(".hex").write_text(intel_hex(image), encoding="ascii")
    table, fits = memory_table(bytes(elf), image, arguments.flash, arguments.ram)
    print(f"{path.name}: crc32 {struct.unpack('<I', image[-4:])[0]:08x}\n{table}")
    if not fits:
        print(f"{path.name}: over its budget", file=sys.stderr)
    return 0 if fits else 1


if __name__ == "__main__":
    sys.exit(main())

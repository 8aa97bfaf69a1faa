#!/usr/bin/env python3
"""Finish the linked firmware.elf for flashing: write the checksum into its last word, and make firmware.bin and .hex.

The image header (firmware/ports/stm32f103/startup.c) has the length of the image. Its last word becomes the CRC-32 of
all bytes before it, in the ELF file as well, so that a debugger loads the same bytes. Prints the memory table. The
output is reproducible byte for byte.

Exit code 0: done. 1: not a plumb image, or over its budget. 2: it cannot be read, or objcopy is missing.
"""

from __future__ import annotations

import argparse
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "host"))

from plumb.errors import PlumbError, UsageError
from plumb.flash.elf import Elf
from plumb.flash.image import FLASH_BASE, HEADER, HEADER_MAGIC, HEADER_OFFSET

RAM_START = 0x20000000
OBJCOPY = "arm-none-eabi-objcopy"


def flat_image(elf: Elf) -> bytes:
    """The image from FLASH_BASE on, with gaps as erased flash. Raises ValueError for an ELF file that is not an
    image."""
    pieces = [(segment.load - FLASH_BASE, segment.data) for segment in elf.segments if segment.data]
    if not pieces or min(pieces)[0] < 0:
        raise ValueError("it has content outside the flash")
    image = bytearray(b"\xff" * max(start + len(data) for start, data in pieces))
    for start, data in pieces:
        image[start : start + len(data)] = data
    if len(image) < HEADER_OFFSET + HEADER.size:
        raise ValueError("it is too short for an image header")
    magic, _, size, *_ = HEADER.unpack_from(image, HEADER_OFFSET)
    if magic != HEADER_MAGIC or size != len(image):
        raise ValueError("its image header is missing or does not give its length")
    return bytes(image)


def objcopy(*arguments: str) -> None:
    program = shutil.which(OBJCOPY)
    if program is None:
        raise UsageError(f"{OBJCOPY} is not installed; install gcc-arm-none-eabi")
    subprocess.run([program, *arguments], check=True)


def finish(path: Path, image: bytes) -> None:
    """Write the checksum into the ELF file, then .bin and .hex into the same folder."""
    checksum = struct.pack("<I", zlib.crc32(image[:-4]))
    with tempfile.NamedTemporaryFile(dir=path.parent) as word:
        word.write(checksum)
        word.flush()
        objcopy("--update-section", f".image_crc={word.name}", str(path))
    objcopy("-O", "ihex", str(path), str(path.with_suffix(".hex")))
    path.with_suffix(".bin").write_bytes(image[:-4] + checksum)


def memory_table(elf: Elf) -> int:
    """Print the sections with their addresses; returns the RAM used, stack included."""
    ram = 0
    for section in elf.sections:
        if section.size:
            print(f"  {section.name:<14} {section.size:>6} bytes at 0x{section.address:08x}")
            ram += section.size if section.address >= RAM_START else 0
    return ram


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("image", type=Path, help="firmware.elf, changed in place")
    options = parser.parse_args()
    path: Path = options.image
    try:
        elf = Elf(path)
        image = flat_image(elf)
        ram = memory_table(elf)
        limit = elf.limits
        flash_free, ram_free = limit["flash"] - len(image), limit["ram"] - ram
        print(f"  flash {len(image)} of {limit['flash']} bytes, {flash_free} free")
        print(f"  RAM with stack {ram} of {limit['ram']} bytes, {ram_free} free")
        if len(image) > limit["flash"] or ram > limit["ram"]:
            raise ValueError("it is over its budget")
        finish(path, image)
    except PlumbError as error:
        print(f"finish_image: {error}", file=sys.stderr)
        return error.exit_code
    except ValueError as error:
        print(f"finish_image: {path.name} cannot become a flash image: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

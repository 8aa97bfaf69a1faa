"""Changed copies of a linked image, for tests of the checks."""

from __future__ import annotations

import struct
from pathlib import Path

from plumb.flash.elf import Elf


def with_flash_limit(elf: Path, limit_bytes: int) -> Path:
    """The same file after its symbol flash_budget was changed."""
    own = Elf(elf).limits["flash"]
    data = elf.read_bytes()
    entry = struct.pack("<IIBBH", own, 0, 0x10, 0, 0xFFF1)  # st_value, st_size, global, st_other, SHN_ABS
    assert data.count(entry) == 1
    elf.write_bytes(data.replace(entry, struct.pack("<I", limit_bytes) + entry[4:]))
    return elf

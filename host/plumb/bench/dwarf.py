"""Places where the compiler inlined functions, from the debug information of an image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plumb.bench.m3_timing import require
from plumb.errors import UsageError


@dataclass(frozen=True)
class Inlined:
    """One place where a function was inlined: its address ranges, each from the first byte to one past the last."""

    name: str
    ranges: tuple[tuple[int, int], ...]

    def __contains__(self, address: int) -> bool:
        return any(start <= address < end for start, end in self.ranges)

    @property
    def size(self) -> int:
        return sum(end - start for start, end in self.ranges)


def inlined(path: Path, names: Sequence[str]) -> list[Inlined]:
    """Every place where one of these functions was inlined and has instructions. Raises UsageError for an image without
    debug information."""
    if not names:
        return []
    with path.open("rb") as file:
        elf = require("elftools.elf.elffile").ELFFile(file)
        if not elf.has_dwarf_info():
            raise UsageError(f"{path} has no debug information, which says where the kernels are: build it with -g")
        dwarf = elf.get_dwarf_info()
        found = []
        for unit in dwarf.iter_CUs():
            for entry in unit.iter_DIEs():
                if entry.tag == "DW_TAG_inlined_subroutine":
                    name = entry.get_DIE_from_attribute("DW_AT_abstract_origin").attributes["DW_AT_name"]
                    if name.value.decode() in names:
                        found.append(Inlined(name.value.decode(), tuple(_ranges(dwarf, unit, entry))))
        return [place for place in found if place.size]


def _ranges(dwarf: Any, unit: Any, entry: Any) -> Iterator[tuple[int, int]]:  # Any: pyelftools has no types
    attributes = entry.attributes
    if "DW_AT_ranges" in attributes:
        low = unit.get_top_DIE().attributes.get("DW_AT_low_pc")
        base = low.value if low is not None else 0
        for part in dwarf.range_lists().get_range_list_at_offset(attributes["DW_AT_ranges"].value, unit):
            if hasattr(part, "base_address"):
                base = part.base_address
            else:
                offset = 0 if part.is_absolute else base
                yield part.begin_offset + offset, part.end_offset + offset
    elif "DW_AT_low_pc" in attributes:
        start, length = attributes["DW_AT_low_pc"].value, attributes["DW_AT_high_pc"]
        yield start, length.value if length.form == "DW_FORM_addr" else start + length.value

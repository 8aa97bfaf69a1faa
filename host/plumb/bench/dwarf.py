"""Places where the compiler inlined functions, and the source file of every other function, by the debug information of
an image."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plumb.bench.m3_timing import require
from plumb.errors import UsageError

PLACED = ("DW_TAG_subprogram", "DW_TAG_variable")
DW_OP_ADDR = 3
"""Operation of a location: the address that follows."""


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
    with _dwarf(path) as dwarf:
        found = []
        for unit in dwarf.iter_CUs():
            for entry in unit.iter_DIEs():
                if entry.tag == "DW_TAG_inlined_subroutine":
                    name = entry.get_DIE_from_attribute("DW_AT_abstract_origin").attributes["DW_AT_name"]
                    if name.value.decode() in names:
                        found.append(Inlined(name.value.decode(), tuple(_ranges(dwarf, unit, entry))))
        return [place for place in found if place.size]


def written_in(path: Path) -> dict[int, str]:
    """Address of each function and variable that link-time optimisation placed -> file that it was written in, as the
    compiler was given it. Raises UsageError for an image without debug information."""
    found = {}
    with _dwarf(path) as dwarf:
        for unit in dwarf.iter_CUs():
            for entry in unit.iter_DIEs():
                if entry.tag not in PLACED or "DW_AT_abstract_origin" not in entry.attributes:
                    continue
                address = _address(entry)
                if address is not None:
                    origin = entry.get_DIE_from_attribute("DW_AT_abstract_origin").cu.get_top_DIE()
                    found[address] = origin.attributes["DW_AT_name"].value.decode()
    return found


@contextlib.contextmanager
def _dwarf(path: Path) -> Iterator[Any]:  # Any: pyelftools has no types
    with path.open("rb") as file:
        elf = require("elftools.elf.elffile").ELFFile(file)
        if not elf.has_dwarf_info():
            raise UsageError(f"{path} has no debug information, which says where functions are: build it with -g")
        yield elf.get_dwarf_info()


def _address(entry: Any) -> int | None:  # Any: pyelftools has no types
    """Address of a function or variable, if it has one."""
    if "DW_AT_low_pc" in entry.attributes:
        return int(entry.attributes["DW_AT_low_pc"].value)
    location = entry.attributes.get("DW_AT_location")
    if location is None or location.form != "DW_FORM_exprloc" or location.value[:1] != [DW_OP_ADDR]:
        return None
    return int.from_bytes(bytes(location.value[1:5]), "little")


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

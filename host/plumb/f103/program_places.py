"""Function and line of an address, from the ELF file of a program (pyelftools, where it is installed)."""

from __future__ import annotations

import bisect
import contextlib
from functools import cached_property
from pathlib import Path
from typing import Any

from plumb.f103.core.program_fault import Places

ELF_MAGIC = b"\x7fELF"


def _nowhere(_address: int) -> str:
    return ""


class ElfPlaces:
    """`places(address)` is 'function (file.c:12)', 'function' without debug information, '' outside all functions.
    Nothing is read before the first call, which takes a second for a large program."""

    WIRING = frozenset({"_functions", "_lines"})

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def of(cls, image: bytes | Path) -> Places:
        """The places of an image; of one that is no ELF file, none."""
        if isinstance(image, Path):
            with contextlib.suppress(OSError), image.open("rb") as stream:
                if stream.read(4) == ELF_MAGIC:
                    return cls(image)
        return _nowhere

    def __call__(self, address: int) -> str:
        try:
            function, line = self._at(self._functions, address), self._at(self._lines, address)
        except Exception:  # a file that the library cannot read tells no place; the fault is reported without one
            return ""
        return f"{function} ({line})" if function and line else function or line

    @staticmethod
    def _at(rows: list[tuple[int, int, str]], address: int) -> str:
        index = bisect.bisect(rows, (address, 1 << 33, "")) - 1
        return rows[index][2] if index >= 0 and address < rows[index][1] else ""

    def _elf(self, stream: Any) -> Any:  # Any: pyelftools has no types
        from elftools.elf.elffile import ELFFile

        return ELFFile(stream)

    @cached_property
    def _functions(self) -> list[tuple[int, int, str]]:
        with self.path.open("rb") as stream:
            symbols = self._elf(stream).get_section_by_name(".symtab")
            rows = [] if symbols is None else list(symbols.iter_symbols())
        functions = [
            (row["st_value"] & ~1, row["st_size"], row.name) for row in rows if row["st_info"]["type"] == "STT_FUNC"
        ]
        return sorted((start, start + max(size, 2), name) for start, size, name in functions)

    @cached_property
    def _lines(self) -> list[tuple[int, int, str]]:
        rows: list[tuple[int, int, str]] = []
        with self.path.open("rb") as stream:
            elf = self._elf(stream)
            for unit in elf.get_dwarf_info().iter_CUs() if elf.has_dwarf_info() else ():
                program = elf.get_dwarf_info().line_program_for_CU(unit)
                rows += _lines_of(program) if program is not None else []
        return sorted(rows)


def _lines_of(program: Any) -> list[tuple[int, int, str]]:  # Any: pyelftools has no types
    """Stretches of addresses with their file and line."""
    files, first = program["file_entry"], 0 if program["version"] >= 5 else 1
    rows: list[tuple[int, int, str]] = []
    before = None
    for entry in program.get_entries():
        state = entry.state
        if state is None:
            continue
        if before is not None and state.address > before.address:
            rows.append((before.address, state.address, f"{files[before.file - first].name.decode()}:{before.line}"))
        before = None if state.end_sequence else state
    return rows

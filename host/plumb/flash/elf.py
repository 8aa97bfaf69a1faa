"""Reader of linked Arm ELF files: segments, sections, symbols, and which bytes are instructions.

Standard library only: boards read their image's symbols with it, and one reading takes 10 ms.
"""

from __future__ import annotations

import bisect
import struct
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

from plumb.errors import UsageError
from plumb.files.input_files import read_bytes

MOST_BYTES = 64 << 20
"""Largest file, and largest total of its segments: an image with its debug information has 1 MiB."""
MOST_SYMBOLS, LONGEST_NAME = 1 << 16, 256
CODE, DATA = "$t", "$d"
"""Mapping symbols (ELF for the Arm architecture, 5.5.5): from here on Thumb instructions, from here on data. A further
name may follow behind a dot."""


@dataclass(frozen=True)
class Section:
    name: str
    address: int
    size: int
    in_file: bool
    writable: bool


@dataclass(frozen=True)
class Segment:
    """A loadable segment: its bytes are stored at `load` and used at `address`, where they take `memory_bytes`."""

    load: int
    address: int
    data: bytes
    memory_bytes: int


@dataclass(frozen=True)
class Symbol:
    name: str
    address: int
    size: int
    is_function: bool


class Elf:
    """A 32-bit little-endian Arm executable; raises UsageError for anything else."""

    def __init__(self, path: Path) -> None:
        self.path = path
        data = read_bytes(path, MOST_BYTES, "build it with: make image")
        if data[:6] != b"\x7fELF\x01\x01" or len(data) < 52 or struct.unpack_from("<H", data, 18)[0] != 40:
            raise UsageError(f"{path} is not an ELF file for Arm")
        try:
            self._parse(data)
        except (struct.error, IndexError, ValueError):
            raise UsageError(f"{path} is damaged: build it again") from None

    def _parse(self, data: bytes) -> None:
        program_at, section_at = struct.unpack_from("<2I", data, 28)
        program_size, program_count, section_size, section_count, names_index = struct.unpack_from("<5H", data, 42)
        self.segments, left = [], len(data)
        for index in range(program_count):
            kind, offset, address, load, in_file, in_memory = struct.unpack_from(
                "<6I", data, program_at + index * program_size
            )
            if kind == 1 and in_memory:
                self.segments.append(Segment(load, address, data[offset : offset + in_file], in_memory))
                left -= in_file
                if left < 0:
                    raise ValueError("its segments overlap")
        headers = [struct.unpack_from("<10I", data, section_at + i * section_size) for i in range(section_count)]

        def text(table: int, at: int) -> str:
            start = headers[table][4] + at
            return data[start : data.index(b"\0", start, start + LONGEST_NAME)].decode()

        self.sections = [
            Section(text(names_index, h[0]), h[3], h[5], h[1] != 8, bool(h[2] & 1)) for h in headers if h[2] & 2
        ]
        self.symbols: dict[str, Symbol] = {}
        self._placed: list[Symbol] = []  # all of them: statics of two files may share a name
        tables = [header for header in headers if header[1] == 2]
        if sum(header[5] for header in tables) > 16 * MOST_SYMBOLS:
            raise ValueError("it has more symbols than any image")
        for header in tables:
            for at in range(header[4], header[4] + header[5], 16):
                name, value, size, info, _, section = struct.unpack_from("<3I2BH", data, at)
                if info & 15 in (0, 1, 2) and section != 0 and name:
                    is_function = info & 15 == 2
                    symbol = Symbol(text(header[6], name), value & ~int(is_function), size, is_function)
                    self.symbols[symbol.name] = symbol
                    self._placed.append(symbol)

    @cached_property
    def _by_address(self) -> tuple[list[int], list[Symbol]]:
        sized = sorted((s for s in self._placed if s.size), key=lambda s: s.address)
        return [s.address for s in sized], sized

    def symbol(self, name: str) -> Symbol:
        if name not in self.symbols:
            raise UsageError(f"{self.path.name} has no symbol {name}: it was inlined, stripped, or never linked in")
        return self.symbols[name]

    def symbol_at(self, address: int) -> Symbol | None:
        """The function or object that covers an address."""
        addresses, symbols = self._by_address
        index = bisect.bisect_right(addresses, address) - 1
        if index >= 0 and address < symbols[index].address + symbols[index].size:
            return symbols[index]
        return None

    def symbols_between(self, start: int, end: int) -> list[Symbol]:
        """Functions and objects whose first byte lies in start <= address < end, in order."""
        addresses, symbols = self._by_address
        return symbols[bisect.bisect_left(addresses, start) : bisect.bisect_left(addresses, end)]

    @property
    def functions(self) -> list[Symbol]:
        """Functions with their bytes, by address, each once; of several names of a function the first one."""
        found: dict[int, Symbol] = {}
        for symbol in self._placed:
            if symbol.is_function and symbol.size:
                found.setdefault(symbol.address, symbol)
        return [found[address] for address in sorted(found)]

    @cached_property
    def _mapping(self) -> tuple[list[int], list[bool]]:
        """Addresses of the mapping symbols, and whether instructions follow."""
        kinds = {s.address: s.name[:2] == CODE for s in self._placed if s.name.split(".")[0] in (CODE, DATA)}
        return sorted(kinds), [kinds[address] for address in sorted(kinds)]

    def code_of(self, function: Symbol) -> list[tuple[int, bytes]]:
        """Address and bytes of the instructions of a function, without the parts that the mapping symbols mark as
        data."""
        addresses, are_code = self._mapping
        end = function.address + function.size
        inside = addresses[bisect.bisect_right(addresses, function.address) : bisect.bisect_left(addresses, end)]
        pieces = []
        for start, stop in pairwise([function.address, *inside, end]):
            index = bisect.bisect_right(addresses, start) - 1
            if index < 0 or are_code[index]:
                pieces.append((start, self.bytes_at(start, stop - start)))
        return pieces

    def bytes_at(self, address: int, size: int) -> bytes:
        for segment in self.segments:
            if segment.address <= address < segment.address + len(segment.data):
                at = address - segment.address
                return segment.data[at : at + size]
        raise UsageError(f"{self.path.name} holds nothing at 0x{address:08x}")

    @property
    def limits(self) -> dict[str, int]:
        """Limits of the image in bytes, from its linker script: flash, ram (data and reserved stack), and stack (the
        reserve). Raises UsageError for a file that was linked by another script."""
        names = {"flash": "flash_budget", "ram": "ram_budget", "stack": "stack_bytes"}
        return {kind: self.symbol(name).address for kind, name in names.items()}

    @property
    def flash_bytes(self) -> int:
        """Size in flash: everything that is loaded, initial values of variables included."""
        return sum(len(segment.data) for segment in self.segments)

    @property
    def ram_bytes(self) -> int:
        """Size of .data, .bss and all other writable sections, without the reserved stack."""
        return sum(s.size for s in self.sections if s.writable and "stack" not in s.name)

    @property
    def reserved_stack_bytes(self) -> int:
        """Size of the section that is reserved for the stack, its guard included."""
        return sum(s.size for s in self.sections if s.writable and "stack" in s.name)

    def vectors(self) -> list[int]:
        """Addresses of the exception handlers, reset first, each once, from the table at the image's lowest address."""
        table = min(self.segments, key=lambda s: s.load).data if self.segments else b""
        handlers: list[int] = []
        words = table[4 : 4 + 4 * (15 + 68)]
        for (word,) in struct.iter_unpack("<I", words[: len(words) & ~3]):
            covered = self.symbol_at(word & ~1) if word & 1 else None
            if word and (covered is None or not covered.is_function):
                break
            if word and word & ~1 not in handlers:
                handlers.append(word & ~1)
        if not handlers:
            raise UsageError(f"{self.path.name} does not begin with a vector table")
        return handlers

    def vector(self, exception: int) -> int | None:
        """Address of the handler of an exception; None when the table is too short."""
        table = min(self.segments, key=lambda s: s.load).data
        if len(table) < 4 * (exception + 1):
            return None
        address = struct.unpack_from("<I", table, 4 * exception)[0] & ~1
        return address if address in self.vectors() else None

"""Reader of linked Arm ELF files: segments, sections, symbols, and the call graph of the machine code.

Standard library only, so that the build can use it; the machine code is disassembled by the toolchain's objdump.
"""

from __future__ import annotations

import bisect
import re
import shutil
import struct
import subprocess
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from plumb.errors import UsageError

OBJDUMP = "arm-none-eabi-objdump"
EXCEPTION_FRAME_BYTES = 36
"""Eight registers, and one word where the stack was not 8-byte aligned (ARMv7-M manual, exception entry)."""
SYSTICK = 15
"""Its exception number."""


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
        try:
            data = path.read_bytes()
        except OSError:
            raise UsageError(f"there is no image {path}; build it with: make image") from None
        if data[:6] != b"\x7fELF\x01\x01" or len(data) < 52 or struct.unpack_from("<H", data, 18)[0] != 40:
            raise UsageError(f"{path} is not an ELF file for Arm")
        try:
            self._parse(data)
        except (struct.error, IndexError, ValueError):
            raise UsageError(f"{path} is damaged: build it again") from None

    def _parse(self, data: bytes) -> None:
        program_at, section_at = struct.unpack_from("<2I", data, 28)
        program_size, program_count, section_size, section_count, names_index = struct.unpack_from("<5H", data, 42)
        self.segments = []
        for index in range(program_count):
            kind, offset, address, load, in_file, in_memory = struct.unpack_from(
                "<6I", data, program_at + index * program_size
            )
            if kind == 1 and in_memory:
                self.segments.append(Segment(load, address, data[offset : offset + in_file], in_memory))
        headers = [struct.unpack_from("<10I", data, section_at + i * section_size) for i in range(section_count)]

        def text(table: int, at: int) -> str:
            start = headers[table][4] + at
            return data[start : data.index(b"\0", start)].decode()

        self.sections = [
            Section(text(names_index, h[0]), h[3], h[5], h[1] != 8, bool(h[2] & 1)) for h in headers if h[2] & 2
        ]
        self.symbols: dict[str, Symbol] = {}
        self._placed: list[Symbol] = []  # all of them: statics of two files may share a name
        for header in (h for h in headers if h[1] == 2):
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

    def bytes_at(self, address: int, size: int) -> bytes:
        for segment in self.segments:
            if segment.address <= address < segment.address + len(segment.data):
                at = address - segment.address
                return segment.data[at : at + size]
        raise UsageError(f"{self.path.name} holds nothing at 0x{address:08x}")

    @property
    def limits(self) -> dict[str, int]:
        """What the image may take, in bytes, as its linker script says: flash, ram (data and reserved stack), and stack
        (the reserve). Raises UsageError for a file that was linked by another script."""
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

    def vectors(self) -> list[int]:
        """Addresses of the exception handlers, reset first, each once, from the table at the image's lowest address."""
        table = min(self.segments, key=lambda s: s.load).data
        handlers: list[int] = []
        for (word,) in struct.iter_unpack("<I", table[4 : 4 + 4 * (15 + 68)]):
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


@dataclass
class Function:
    """One function's machine code as a graph: its calls, and the depth of the stack at each."""

    name: str
    address: int
    depth_bytes: int = 0
    calls: dict[int, int] = field(default_factory=dict)  # callee -> own stack depth at the call
    indirect: list[int] = field(default_factory=list)  # calls through a register
    unbounded: list[int] = field(default_factory=list)  # the stack pointer moves by an unknown amount


@dataclass(frozen=True)
class _Line:
    address: int
    name: str
    operands: str
    target: int | None


_LABEL = re.compile(r"^([0-9a-f]{8}) <(.+)>:$")
_CODE = re.compile(r"^\s*([0-9a-f]+):\t([a-z][a-z0-9.]*)\s*(.*)$")
_TARGET = re.compile(r"\b([0-9a-f]+) <")
_CONDITIONS = "eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|hs|lo"
_CALL = re.compile(rf"blx?({_CONDITIONS})?$")
_BRANCH = re.compile(rf"b({_CONDITIONS})?$|cbn?z$")


def _disassemble(path: Path) -> dict[int, tuple[str, list[_Line]]]:
    """Function address -> name and instructions; data inside functions is left out."""
    program = shutil.which(OBJDUMP)
    if program is None:
        raise UsageError(f"{OBJDUMP} is not installed; on Debian or Ubuntu: apt install binutils-arm-none-eabi")
    command = [program, "--disassemble", "--no-show-raw-insn", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if result.returncode:
        raise UsageError(f"{OBJDUMP} cannot read {path}: {result.stderr.strip()}")
    functions: dict[int, tuple[str, list[_Line]]] = {}
    lines: list[_Line] = []
    for text in result.stdout.splitlines():
        if label := _LABEL.match(text):
            lines = functions.setdefault(int(label[1], 16), (label[2], []))[1]
        elif code := _CODE.match(text):
            operands = code[3].split("@")[0].split(";")[0].strip()
            target = _TARGET.search(operands)
            name = code[2].split(".")[0]
            lines.append(_Line(int(code[1], 16), name, operands, int(target[1], 16) if target else None))
    return functions


def _registers(operands: str) -> int:
    inside = operands[operands.index("{") + 1 : operands.index("}")]
    count = 0
    for part in inside.split(","):
        ends = re.findall(r"r(\d+)", part)
        count += int(ends[1]) - int(ends[0]) + 1 if len(ends) == 2 else 1
    return count


def _stack_growth(line: _Line) -> int | None:
    """Bytes by which an instruction grows the stack; None when that is unknown.

    MSR MSP, by which a fault handler returns to the top of the stack for good, counts as no growth.
    """
    name, operands = line.name, line.operands
    if name in ("push", "pop"):
        return 4 * _registers(operands) * (1 if name == "push" else -1)
    if name in ("stmdb", "ldmia", "ldm") and operands.startswith("sp!"):
        return 4 * _registers(operands) * (1 if name == "stmdb" else -1)
    moved = re.search(r"\[sp, #(-?\d+)\]!|\[sp\], #(-?\d+)", operands)
    if moved:
        return -int(moved[1] or moved[2])
    if name in ("stmia", "stm", "ldmia", "ldm"):
        return 0  # without write-back; the others are above
    if operands.startswith("sp,") and name not in ("cmp", "tst", "str", "strd"):
        amount = re.fullmatch(r"sp, (?:sp, )?#(\d+)", operands)
        if amount and name in ("sub", "subw", "add", "addw"):
            return int(amount[1]) * (1 if name.startswith("sub") else -1)
        return None
    return 0


def _ends_path(line: _Line) -> bool:
    """True when execution does not continue with the next instruction."""
    if line.name in ("b", "bx", "tbb", "tbh", "udf"):
        return True
    if line.name in ("pop", "ldmia"):
        return "pc" in line.operands
    return line.name in ("ldr", "mov") and line.operands.startswith("pc,")


def _is_indirect(line: _Line) -> bool:
    """True for a call or jump whose target is in a register, except the return."""
    if _CALL.match(line.name):
        return line.target is None
    if line.name.startswith("bx"):
        return line.operands != "lr"
    return line.name in ("ldr", "mov") and line.operands.startswith("pc,") and not re.search(r"\[sp|lr", line.operands)


def _walk(address: int, name: str, lines: list[_Line]) -> Function:
    """Follows every path through one function and tracks the depth of its stack."""
    function = Function(name, address)
    index = {line.address: i for i, line in enumerate(lines)}
    deepest: dict[int, int] = {}
    table_depth: int | None = None
    work = [(0, 0)]
    while work:
        at, depth = work.pop()
        if at < len(lines) and deepest.get(at, -1) < depth:
            deepest[at] = depth
            line = lines[at]
            growth = _stack_growth(line)
            if growth is None:
                function.unbounded.append(line.address)
            if _is_indirect(line):
                function.indirect.append(line.address)
            elif _CALL.match(line.name) or _BRANCH.match(line.name):
                assert line.target is not None
                if line.target in index and not _CALL.match(line.name):
                    work.append((index[line.target], depth))
                else:  # a call, or a tail call
                    function.calls[line.target] = max(depth, function.calls.get(line.target, 0))
            elif line.name in ("tbb", "tbh"):
                table_depth = max(depth, table_depth or 0)
            function.depth_bytes = max(function.depth_bytes, depth + (growth or 0))
            if not _ends_path(line):
                work.append((at + 1, depth + (growth or 0)))
        if not work and table_depth is not None:  # code that only a jump table reaches
            work = [(i, table_depth) for i in range(len(lines)) if i not in deepest][:1]
    return function


class CallGraph:
    """Call graph of an image, and the stack of its deepest chain of calls."""

    def __init__(self, path: Path) -> None:
        self.elf = Elf(path)
        if not any(symbol.is_function for symbol in self.elf.symbols.values()):
            raise UsageError(f"{path} is stripped: its call graph needs the .elf with symbols")
        self.functions = {
            address: _walk(address, name, lines) for address, (name, lines) in _disassemble(path).items() if lines
        }

    def name(self, address: int) -> str:
        return self.functions[address].name if address in self.functions else f"0x{address:08x}"

    def recursion(self) -> list[str] | None:
        """A chain of calls that returns to its first function, by name; None when there is none."""
        state: dict[int, int] = {}
        for root in self.functions:
            chain = self._cycle_from(root, state, [])
            if chain:
                return [self.name(address) for address in chain]
        return None

    def _cycle_from(self, at: int, state: dict[int, int], chain: list[int]) -> list[int] | None:
        if state.get(at) == 2 or at not in self.functions:
            return None
        if state.get(at) == 1:
            return [*chain[chain.index(at) :], at]
        state[at] = 1
        for callee in self.functions[at].calls:
            found = self._cycle_from(callee, state, [*chain, at])
            if found:
                return found
        state[at] = 2
        return None

    def stack_bytes(self, address: int) -> int:
        """Stack of one function with everything that it calls; the image must be free of recursion."""
        if address not in self._stack:
            function = self.functions.get(address)
            below = max((d + self.stack_bytes(c) for c, d in function.calls.items()), default=0) if function else 0
            self._stack[address] = max(function.depth_bytes, below) if function else 0
        return self._stack[address]

    @cached_property
    def _stack(self) -> dict[int, int]:
        return {}

    def reachable(self, address: int) -> set[int]:
        found: set[int] = set()
        work = [address]
        while work:
            at = work.pop()
            if at in self.functions and at not in found:
                found.add(at)
                work.extend(self.functions[at].calls)
        return found

    def worst_stack_bytes(self) -> int:
        """Deepest stack: the reset handler's chain, plus the deepest interrupt handler, plus SysTick's handler, plus
        the frame of a fault, whose handler starts a stack of its own. All handlers but SysTick's have the same
        priority, which tests/boards/test_registers.py and test_hangs.py check in the firmware."""
        reset, *handlers = self.elf.vectors()
        systick = self.elf.vector(SYSTICK)
        deepest = max((self.stack_bytes(handler) for handler in handlers if handler != systick), default=0)
        preempting = EXCEPTION_FRAME_BYTES + self.stack_bytes(systick) if systick is not None else 0
        return self.stack_bytes(reset) + EXCEPTION_FRAME_BYTES + deepest + preempting + EXCEPTION_FRAME_BYTES

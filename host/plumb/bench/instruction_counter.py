"""Calls C functions inside a linked Arm image and counts their instructions; plumb.bench.m3_timing computes the cycles.

A watched function that was inlined is found by the debug information (plumb.bench.dwarf): the instructions that came
from it count as one call, with the cycles that they take in their place.

The function runs in an emulator (Unicorn), which records the executed basic blocks; the cost is computed from them.
Nothing is sampled: one input gives one number, the same on every machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from plumb.bench.dwarf import Inlined, inlined
from plumb.bench.m3_timing import (
    TABLE_READ_CYCLES_2WS,
    Cost,
    Decoder,
    Instruction,
    instruction_cycles,
    path_steps,
    require,
    steps_cost,
)
from plumb.bench.path_costs import PathCosts
from plumb.errors import UsageError
from plumb.f103.machine import Machine
from plumb.f103.peripherals import crc
from plumb.flash.elf import Elf, Symbol

RCC_PAGE = 0x4002_1000
MAGIC_RETURN = 0x1F00_0000  # an empty page of the code region: reaching it ends a call
ARGUMENT_BASE = 0x6000_0000  # the bench's own page of RAM, for arguments
ARGUMENT_BYTES = 0x10000
STACK_BASE = 0x7000_0000  # the bench's own stack, so that the image's RAM is not changed
STACK_BYTES = 0x10000
LIMIT_BLOCKS = 200_000  # a call that takes more counts as hung


@dataclass
class Call:
    """One finished call of a symbol: its result register, its path and the cost of the path."""

    result: int
    blocks: tuple[int, ...]
    cost: Cost


class Image(Elf):
    """A linked Arm ELF file with decoded instructions."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        if not self.symbols:
            raise UsageError(f"{path} has no symbols; the bench needs the .elf, not a stripped image")
        self._decoder = Decoder()
        self._decoded: dict[int, Instruction] = {}

    def instruction(self, address: int) -> Instruction:
        if address not in self._decoded:
            self._decoded[address] = self._decoder.decode(self.bytes_at(address, 4), address)
        return self._decoded[address]


@dataclass
class Profile:
    """Worst case of many calls of one function. stack: for an inlined function, the stack of the whole step at that
    place."""

    name: str
    calls: int = 0
    instructions_max: int = 0
    cycles_max: int = 0
    cycles_sum: int = 0
    cycles_2ws_max: int = 0
    stack: int = 0
    instructions_min: int = 1 << 31
    worst: tuple[int, ...] = ()

    def add(self, blocks: tuple[int, ...], cost: Cost) -> None:
        self.calls += 1
        if cost.cycles > self.cycles_max:
            self.worst = blocks
        self.instructions_max = max(self.instructions_max, cost.instructions)
        self.instructions_min = min(self.instructions_min, cost.instructions)
        self.cycles_max = max(self.cycles_max, cost.cycles)
        self.cycles_sum += cost.cycles
        self.cycles_2ws_max = max(self.cycles_2ws_max, cost.cycles_2ws)
        self.stack = max(self.stack, cost.stack)


class Counter:
    """Calls functions of an image by symbol and counts their cost, including nested calls of watched functions.

    Arguments are 32-bit integers; memory for pointers comes from place() and is read back with read().
    """

    def __init__(self, image: Image, watch: Sequence[str] = ()) -> None:
        uc, arm, const = require("unicorn"), require("unicorn.arm_const"), require("unicorn.unicorn_const")
        self.image = image
        self._arm, self._error = arm, uc.UcError
        self._uc = uc.Uc(const.UC_ARCH_ARM, const.UC_MODE_THUMB | const.UC_MODE_MCLASS)
        self._uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M3)
        mapped: set[int] = set()
        for segment in image.segments:
            for base, size in ((segment.address, segment.memory_bytes), (segment.load, len(segment.data))):
                for page in range(base & ~0xFFF, base + size, 0x1000):
                    if page not in mapped:
                        self._uc.mem_map(page, 0x1000)
                        mapped.add(page)
                self._uc.mem_write(base, segment.data)
        self._uc.mem_map(ARGUMENT_BASE, ARGUMENT_BYTES)
        self._uc.mem_map(STACK_BASE, STACK_BYTES)
        self._uc.mem_map(MAGIC_RETURN, 0x1000)
        self._uc.mem_map(RCC_PAGE, 0x1000)  # plain memory: clocks may be switched on
        self._unit_blocks: set[int] = set()  # basic blocks that write words to the CRC unit
        self._unit_words = bytearray()
        self._uc.mmio_map(crc.BASE, 0x1000, self._on_unit_read, None, self._on_unit_write, None)
        self._next_argument = ARGUMENT_BASE
        self._trace: list[int] = []
        self._tables: list[Symbol] = []  # objects in flash that were read; ~index marks a read in the trace
        self._sizes: dict[int, int] = {}
        self._blocks: dict[tuple[int, int], list[Instruction]] = {}
        self._costs: dict[tuple[int, ...], Cost] = {}
        self._path_costs: dict[frozenset[int], PathCosts] = {}
        """Costs of paths, by the set of stores to the CRC unit that was known at the time."""
        self._nested: dict[tuple[int, ...], list[tuple[str, tuple[int, ...]]]] = {}
        self.profiles = {name: Profile(name) for name in watch}
        self._watched = {image.symbols[name].address: name for name in watch if name in image.symbols}
        self._inlined = inlined(image.path, [name for name in watch if name not in image.symbols])
        for name in watch:
            if name not in image.symbols and all(place.name != name for place in self._inlined):
                raise UsageError(f"{image.path.name} has no {name}: neither as a function nor inlined")
        self._parts: dict[tuple[int, ...], list[tuple[Inlined, Cost, set[int]]]] = {}
        self._uc.hook_add(const.UC_HOOK_BLOCK, self._on_block)
        code = min(image.segments, key=lambda segment: segment.address)
        self._uc.hook_add(
            const.UC_HOOK_MEM_READ, self._on_flash_read, begin=code.address, end=code.address + len(code.data)
        )

    def _on_block(self, _uc: object, address: int, size: int, _data: object) -> None:
        self._trace.append(address)
        if len(self._trace) > LIMIT_BLOCKS:
            self._uc.emu_stop()
        self._sizes[address] = size

    def _on_unit_read(self, _uc: object, offset: int, _size: int, _data: object) -> int:
        return crc.remainder(crc.START, self._unit_words) if offset == crc.DR_OFFSET else 0

    def _on_unit_write(self, _uc: object, offset: int, _size: int, value: int, _data: object) -> None:
        if offset == crc.DR_OFFSET:
            self._unit_words += value.to_bytes(4, "little")
            self._unit_blocks.add(next(block for block in reversed(self._trace) if block >= 0))
        else:
            self._unit_words.clear()  # the only other register that the firmware writes resets it

    def _on_flash_read(self, _uc: object, _kind: int, address: int, _size: int, _value: int, _data: object) -> None:
        symbol = self.image.symbol_at(address)
        if symbol is not None and not symbol.is_function:  # a literal lies in its function, a table does not
            if symbol not in self._tables:
                self._tables.append(symbol)
            self._trace.append(~self._tables.index(symbol))

    def place(self, data: bytes) -> int:
        """Puts bytes into the bench's own RAM, 8-byte aligned, and returns their address."""
        address = self._next_argument
        self._next_argument += (len(data) + 7) & ~7
        if self._next_argument > ARGUMENT_BASE + ARGUMENT_BYTES:
            raise UsageError("The bench's argument memory is full: place less.")
        self._uc.mem_write(address, data)
        return address

    def write(self, address: int, data: bytes) -> None:
        self._uc.mem_write(address, data)

    def read(self, address: int, size: int) -> bytes:
        return bytes(self._uc.mem_read(address, size))

    def call(self, name: str, *arguments: int) -> Call:
        """Runs one function to its return; raises UsageError when it does not return."""
        symbol = self.image.symbol(name)
        uc, arm = self._uc, self._arm
        stack = STACK_BASE + STACK_BYTES - 64
        for register, value in zip((arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3),
                                   arguments, strict=False):  # fmt: skip
            uc.reg_write(register, value & 0xFFFF_FFFF)
        for index, value in enumerate(arguments[4:]):
            uc.mem_write(stack + 4 * index, (value & 0xFFFF_FFFF).to_bytes(4, "little"))
        uc.reg_write(arm.UC_ARM_REG_SP, stack)
        uc.reg_write(arm.UC_ARM_REG_LR, MAGIC_RETURN | 1)
        self._trace.clear()
        try:
            uc.emu_start(symbol.address | 1, MAGIC_RETURN)
        except self._error as error:
            raise UsageError(f"{name} stopped at 0x{uc.reg_read(arm.UC_ARM_REG_PC):08x}: {error}") from None
        if len(self._trace) > LIMIT_BLOCKS:
            raise UsageError(f"{name} did not return within {LIMIT_BLOCKS} basic blocks.")
        blocks = tuple(self._trace)
        self._profile(blocks)
        return Call(uc.reg_read(arm.UC_ARM_REG_R0), blocks, self.cost(blocks))

    def cost(self, blocks: tuple[int, ...]) -> Cost:
        if blocks not in self._costs:
            stores = frozenset(self._unit_stores())
            if stores not in self._path_costs:
                self._path_costs[stores] = PathCosts(stores)
            code = [self._block(start, self._sizes[start]) for start in blocks if start >= 0]
            cost = self._path_costs[stores].of(code)
            tables = sum(block < 0 for block in blocks)
            self._costs[blocks] = replace(cost, cycles_2ws=cost.cycles_2ws + tables * TABLE_READ_CYCLES_2WS)
        return self._costs[blocks]

    def _unit_stores(self) -> set[int]:
        """Addresses of all stores in basic blocks that write to the CRC unit: an upper bound, because within a block
        the emulator does not report the running instruction."""
        return {one.address for one in self.path(tuple(self._unit_blocks)) if one.name == "str"}

    def path(self, blocks: tuple[int, ...]) -> list[Instruction]:
        """The instructions of a path, in the order executed."""
        path: list[Instruction] = []
        for start in blocks:
            if start >= 0:
                path += self._block(start, self._sizes[start])
        return path

    def _block(self, start: int, size: int) -> list[Instruction]:
        """The instructions of a basic block of `size` bytes."""
        if (start, size) not in self._blocks:
            found, address = [], start
            while address < start + size:
                found.append(self.image.instruction(address))
                address += found[-1].size
            self._blocks[start, size] = found
        return self._blocks[start, size]

    def _profile(self, blocks: tuple[int, ...]) -> None:
        """Adds every call of a watched function in a path to its profile."""
        if blocks not in self._nested:
            self._nested[blocks] = [(name, blocks[a:b]) for name, a, b in self._nested_calls(blocks)]
        for name, part in self._nested[blocks]:
            self.profiles[name].add(part, self.cost(part))
        if self._inlined and blocks not in self._parts:
            self._parts[blocks] = list(self._inlined_parts(blocks))
        for place, cost, _ in self._parts.get(blocks, ()):
            self.profiles[place.name].add(blocks, cost)

    def _inlined_parts(self, blocks: tuple[int, ...]) -> Iterator[tuple[Inlined, Cost, set[int]]]:
        """The watched inlined functions on a path: place, cost, and the tables that they read. Reads are only known per
        basic block, and count for every inlined function in the block."""
        steps = list(path_steps(self.path(blocks), self._unit_stores()))
        for place in self._inlined:
            own = [step for step in steps if step.instruction.address in place]
            if own:
                inside, tables = False, []
                for block in blocks:
                    if block >= 0:
                        inside = any(one.address in place for one in self.path((block,)))
                    elif inside:
                        tables.append(block)
                cost = steps_cost(own)
                waits = len(tables) * TABLE_READ_CYCLES_2WS
                yield place, replace(cost, cycles_2ws=cost.cycles_2ws + waits), set(tables)

    def bytes_of(self, name: str) -> int:
        """Size of a watched function: all functions that it executed, callees included, and every table that it read;
        of an inlined function the size at its largest place."""
        places = [(place, tables) for parts in self._parts.values() for place, _, tables in parts if place.name == name]
        if places:
            tables = {self._tables[~table] for _, read in places for table in read}
            return max(place.size for place, _ in places) + sum(table.size for table in tables)
        return sum(part.size for part in self.symbols_of(name))

    def _nested_calls(self, blocks: tuple[int, ...]) -> list[tuple[str, int, int]]:
        """Watched functions that a path enters: name, index of the first block, index after the last block."""
        returns: list[int] = []
        open_calls: list[tuple[str, int, int]] = []  # name, first block, depth of the return stack
        found: list[tuple[str, int, int]] = []
        for index, start in enumerate(blocks):
            if start < 0:
                continue
            if returns and start == returns[-1]:
                returns.pop()
                while open_calls and open_calls[-1][2] > len(returns):
                    name, first, _ = open_calls.pop()
                    found.append((name, first, index))
            if start in self._watched:
                open_calls.append((self._watched[start], index, len(returns)))
            last = self._block(start, self._sizes[start])[-1]
            if last.is_call:
                returns.append(last.address + last.size)
        return found + [(name, first, len(blocks)) for name, first, _ in open_calls]

    def symbols_of(self, name: str) -> set[Symbol]:
        """Every function that the watched one executed, itself included, and every table that it read."""
        seen = {block for path in self._nested.values() for n, part in path if n == name for block in part}
        code = {symbol for symbol in (self.image.symbol_at(b) for b in seen if b >= 0) if symbol is not None}
        return code | {self._tables[~block] for block in seen if block < 0}

    def listing(self, blocks: tuple[int, ...], emit: Callable[[str], None] = print) -> None:
        """Prints a path, for optimisation: address, cycles and text of each instruction."""
        path = self.path(blocks)
        for index, now in enumerate(path):
            before = path[index - 1] if index else None
            after = path[index + 1] if index + 1 < len(path) else None
            taken = after is None or after.address != now.address + now.size
            symbol = self.image.symbol_at(now.address)
            took = instruction_cycles(now, before, taken, after)
            emit(f"{now.address:08x} {took:3d}  {symbol.name if symbol else '?':24s} {now.text}")


class InstructionTrace:
    """The address of every instruction that a simulated part executes from now on, in order."""

    def __init__(self, machine: Machine) -> None:
        self.addresses: list[int] = []
        cpu = machine.cpu
        cpu.loops_at_once = False
        cpu.uc.hook_add(require("unicorn.unicorn_const").UC_HOOK_CODE, self._on_instruction)
        cpu.forget_code()  # code translated before the hook was set would not call it

    def _on_instruction(self, _uc: object, address: int, _size: int, _data: object) -> None:
        self.addresses.append(address)


def _argument(counter: Counter, text: str) -> int:
    """A number, `@N` for a pointer to N zero bytes, or `@a,b,c` for a pointer to 32-bit words."""
    if not text.startswith("@"):
        return int(text, 0)
    words = text[1:].split(",")
    if len(words) == 1:
        return counter.place(bytes(int(words[0], 0)))
    return counter.place(b"".join((int(word, 0) & 0xFFFF_FFFF).to_bytes(4, "little") for word in words))


def main() -> None:
    """`python -m plumb.bench.instruction_counter IMAGE.elf SYMBOL ARGUMENT...`: one call, instruction by instruction,
    and its cost."""
    parser = argparse.ArgumentParser(prog="python -m plumb.bench.instruction_counter", description=main.__doc__)
    parser.add_argument("image", type=Path)
    parser.add_argument("symbol")
    parser.add_argument("arguments", nargs="*", help="number | @N (N zero bytes) | @a,b,c (32-bit words)")
    options = parser.parse_args()
    try:
        counter = Counter(Image(options.image), [options.symbol])
        call = counter.call(options.symbol, *(_argument(counter, text) for text in options.arguments))
    except UsageError as error:
        parser.error(str(error))
    counter.listing(call.blocks)
    print(f"result {call.result:#010x}  {call.cost}")


if __name__ == "__main__":
    main()

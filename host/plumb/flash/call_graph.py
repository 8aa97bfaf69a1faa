"""The call graph of an image's machine code, and the stack of its deepest chain of calls.

Functions are found by their symbols, and instructions in them by the mapping symbols: a table of constants is never
read as code, whatever its bytes look like. capstone disassembles them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from plumb.errors import UsageError
from plumb.flash.elf import Elf
from plumb.flash.thumb import Thumb

EXCEPTION_FRAME_BYTES = 36
"""Eight registers, and one word where the stack was not 8-byte aligned (ARMv7-M manual, exception entry)."""
SYSTICK = 15
"""Its exception number."""


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
class Instruction:
    """Properties of an instruction that affect the stack. growth_bytes: None when the stack grows by an unknown amount;
    target: of a call or branch to a fixed address; name: the mnemonic without condition and width."""

    address: int
    name: str
    growth_bytes: int | None
    target: int | None
    is_call: bool
    is_indirect: bool
    ends_path: bool


class _Reader:
    """Instructions by capstone. A conditional instruction in an IT block may grow the stack, but never shrinks it and
    never ends a path."""

    def __init__(self) -> None:
        self.thumb = Thumb("the call graph")

    def instructions(self, code: bytes, address: int) -> list[Instruction]:
        return [self._of(raw) for raw in self.thumb.instructions(code, address)]

    def _of(self, raw: Any) -> Instruction:  # Any: capstone has no types
        arm, name = self.thumb.arm, self.thumb.name(raw)
        is_call = name in ("bl", "blx")
        fixed = [o.imm & 0xFFFFFFFF for o in raw.operands if o.type == arm.ARM_OP_IMM]
        target = fixed[-1] if fixed and (is_call or name in ("b", "cbz", "cbnz")) else None
        writes_pc = arm.ARM_REG_PC in raw.regs_access()[1] and not is_call and target is None
        skipped = self.thumb.is_conditional(raw)
        change = self.thumb.stack_change(raw)
        growth = None if change is None else max(-change, 0) if skipped else -change
        return Instruction(
            raw.address, name, growth, target, is_call,
            is_indirect=target is None and (is_call or self._jumps_by_register(raw, name, writes_pc)),
            ends_path=not skipped and (name in ("b", "bx", "tbb", "tbh", "udf") or writes_pc),
        )  # fmt: skip

    def _jumps_by_register(self, raw: Any, name: str, writes_pc: bool) -> bool:  # Any: as capstone gives it
        """True for a jump whose target is in a register or in memory, except a return and a jump by table."""
        arm = self.thumb.arm
        if name == "bx":
            return bool(raw.operands[0].reg != arm.ARM_REG_LR)
        if not writes_pc or name in ("pop", "tbb", "tbh"):
            return False
        sources = raw.operands[1:]
        returns = (
            name == "ldm" or (name == "ldr" and sources[0].mem.base == arm.ARM_REG_SP)
            or (name == "mov" and sources[0].reg == arm.ARM_REG_LR)
        )  # fmt: skip
        return not returns


def _walk(address: int, name: str, lines: list[Instruction]) -> Function:
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
            if line.growth_bytes is None:
                function.unbounded.append(line.address)
            if line.is_indirect:
                function.indirect.append(line.address)
            elif line.target is not None:
                if line.target in index and not line.is_call:
                    work.append((index[line.target], depth))
                else:  # a call, or a tail call
                    function.calls[line.target] = max(depth, function.calls.get(line.target, 0))
            elif line.name in ("tbb", "tbh"):
                table_depth = max(depth, table_depth or 0)
            function.depth_bytes = max(function.depth_bytes, depth + (line.growth_bytes or 0))
            if not line.ends_path:
                work.append((at + 1, depth + (line.growth_bytes or 0)))
        if not work and table_depth is not None:  # code that only a jump table reaches
            work = [(i, table_depth) for i in range(len(lines)) if i not in deepest][:1]
    return function


class CallGraph:
    """Call graph of an image, and the stack of its deepest chain of calls."""

    def __init__(self, path: Path) -> None:
        self.elf = Elf(path)
        if not self.elf.functions:
            raise UsageError(f"{path} is stripped: its call graph needs the .elf with symbols")
        reader = _Reader()
        self.functions: dict[int, Function] = {}
        for symbol in self.elf.functions:
            lines = [line for at, code in self.elf.code_of(symbol) for line in reader.instructions(code, at)]
            self.functions[symbol.address] = _walk(symbol.address, symbol.name, lines)

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

    def reachable(self, *addresses: int, closed: Collection[int] = ()) -> set[int]:
        """The functions at these addresses and all functions that they call; closed: functions that are not
        followed."""
        found: set[int] = set()
        work = list(addresses)
        while work:
            at = work.pop()
            if at in self.functions and at not in found and at not in closed:
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

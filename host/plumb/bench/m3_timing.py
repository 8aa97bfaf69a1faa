"""Timing model of the Cortex-M3: cycles of each executed instruction at zero and at two flash wait states.

Source: Cortex-M3 Technical Reference Manual r2p1 (ARM 100165), 3.3.1 "Processor instructions" and 3.3.2 "Load/store
timings".  Where the manual gives a range the model takes the slowest, except that a pipeline refill takes its usual 2:

    data processing, MUL, SSAT, CLZ, IT            1      (an IT that folds onto a 16-bit instruction would take 0)
    MLA, MLS                                       2
    UMULL, SMULL / UMLAL, SMLAL                    5 / 7  (manual: 3-5 and 4-7, by operand)
    UDIV, SDIV                                     12     (manual: 2-12)
    LDR, LDRB, LDRH, ...                           2; 1 directly after a load whose result is not its address
    LDR from the literal pool                      +1     (contention with the fetch unit)
    STR with immediate / register offset           1 / 2; the latter 1 directly after a load, as for LDR
    LDM, STM, PUSH, POP, LDRD, STRD                1 + N registers
    load or store                                  +1 when its address was computed by the instruction directly before
    branch taken, BL, BX, POP {pc}                 +P     P = 2; 3 for a target of 32 bits that is not word-aligned
    LDR pc                                         5
    branch not taken                               1
    TBB, TBH                                       6
    MRS, MSR / barriers                            2 / 4

A conditional instruction in an IT block is charged as if it were executed (a skipped one takes 1 cycle), a conditional
branch as it went.  The call instruction belongs to the caller and is not counted; the return is.

With two flash wait states (72 MHz) the flash delivers one 64-bit line in 3 cycles.  Model: two line buffers; the line
after the one in use is fetched ahead as soon as the flash is idle; an instruction waits until the lines that contain it
have arrived, of which one cycle is the ordinary fetch.  A literal-pool load takes the flash for 3 cycles, 2 of them
lost; any other load from flash is charged 2 + 3 (its own wait, and the prefetch that it delays).  SRAM has no wait
states. The CRC unit takes a word every 4 cycles of HCLK (RM0008 4.2); a store that comes earlier waits.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from plumb.extras import required
from plumb.flash.thumb import Thumb

FLASH_LINE_BYTES = 8
FLASH_READ_CYCLES_2WS = 3
CRC_UNIT_CYCLES = 4
TABLE_READ_CYCLES_2WS = 2 + FLASH_READ_CYCLES_2WS  # a load from flash outside the literal pool

_SINGLE_LOADS = {"ldr", "ldrb", "ldrh", "ldrsb", "ldrsh"}
_SINGLE_STORES = {"str", "strb", "strh"}
_MULTIPLE = {"ldm", "ldmdb", "stm", "stmdb", "push", "pop"}
_MEMORY = _SINGLE_LOADS | _SINGLE_STORES | _MULTIPLE | {"ldrd", "strd"}
_TABLE_BRANCHES = {"tbb", "tbh"}
_CYCLES = {
    "mla": 2, "mls": 2, "umull": 5, "smull": 5, "umlal": 7, "smlal": 7, "udiv": 12, "sdiv": 12, "ldrd": 3, "strd": 3,
     "mrs": 2, "msr": 2, "dsb": 4, "dmb": 4, "isb": 4, "ldrex": 2, "strex": 2, "clrex": 2,
}  # fmt: skip


@dataclass(frozen=True)
class Instruction:
    """One decoded instruction, with the properties that the timing model needs."""

    address: int
    size: int
    text: str
    name: str
    reads_address: frozenset[int]  # registers that form a memory address
    writes: frozenset[int]
    registers: int  # length of the register list of LDM and friends
    is_literal: bool  # a load from the literal pool
    is_register_offset: bool
    is_call: bool
    stack_change: int  # bytes by which it moves the stack pointer; negative = grows

    is_data_processing: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "is_data_processing", self.name not in _MEMORY)


@dataclass(frozen=True)
class Cost:
    """Cost of one call: cycles at zero and at two flash wait states; stack in bytes, callees included."""

    instructions: int
    cycles: int
    cycles_2ws: int
    stack: int


PURPOSE = "counting cycles"


def require(module: str) -> Any:  # Any: a package without types
    package = {"elftools": "pyelftools"}.get(module.split(".")[0], module.split(".")[0])
    return required(module, package, PURPOSE, "bench")


class Decoder:
    """Decodes Thumb-2 machine code to Instruction; ignores the condition of an IT block."""

    def __init__(self) -> None:
        self._thumb = Thumb(PURPOSE)

    def decode(self, code: bytes, address: int) -> Instruction:
        """The first instruction in `code`, which lies at `address`."""
        thumb, arm = self._thumb, self._thumb.arm
        raw = thumb.first(code, address)
        name = thumb.name(raw)
        _, written = raw.regs_access()
        memory = [operand for operand in raw.operands if operand.type == arm.ARM_OP_MEM]
        bases = frozenset(r for o in memory for r in (o.mem.base, o.mem.index) if r)
        listed = thumb.registers(raw)
        if name in ("push", "pop"):
            bases = frozenset({arm.ARM_REG_SP})
        elif name in _MULTIPLE:
            bases = frozenset({listed[0]})
        count = len(listed) if name in ("push", "pop") else max(len(listed) - 1, 0)
        return Instruction(
            address, raw.size, f"{raw.mnemonic} {raw.op_str}".strip(), name, bases, frozenset(written), count,
            is_literal=arm.ARM_REG_PC in bases, is_register_offset=any(o.mem.index for o in memory),
            is_call=name in ("bl", "blx"), stack_change=thumb.stack_change(raw) or 0,
        )  # fmt: skip


def _refill(target: Instruction | None) -> int:
    return 3 if target is not None and target.size == 4 and target.address % 4 else 2


def instruction_cycles(now: Instruction, before: Instruction | None, taken: bool, target: Instruction | None) -> int:
    """Cycles of one instruction at zero wait states, given the one executed before it and whether it branched."""
    depends = before is not None and not before.writes.isdisjoint(now.reads_address)
    after_load = before is not None and before.name in _SINGLE_LOADS and not depends
    if now.name in _SINGLE_LOADS:
        cycles = (1 if after_load else 2) + (1 if now.is_literal else 0)
    elif now.name in _SINGLE_STORES:
        cycles = 2 if now.is_register_offset and not after_load else 1
    elif now.name in _MULTIPLE:
        cycles = 1 + now.registers
    else:
        cycles = _CYCLES.get(now.name, 1)
    if depends and before is not None and before.is_data_processing:
        cycles += 1
    if taken:
        cycles += 3 if now.name in _SINGLE_LOADS else 5 if now.name in _TABLE_BRANCHES else _refill(target)
    return cycles


class _Flash:
    """Flash that needs three cycles for a 64-bit line, with two line buffers."""

    def __init__(self) -> None:
        self.time = 0  # when the next instruction may start
        self._free = 0  # when the flash can start the next read
        self._ready: dict[int, int] = {}  # line -> arrival

    def _read(self, line: int) -> None:
        """Read a line that is not in a buffer."""
        self._free = max(self.time, self._free) + FLASH_READ_CYCLES_2WS
        while len(self._ready) > 1:
            self._ready.pop(next(iter(self._ready)))
        self._ready[line] = self._free

    def execute(self, now: Instruction, cycles: int) -> None:
        ready, first = self._ready, now.address // FLASH_LINE_BYTES
        last = (now.address + now.size - 1) // FLASH_LINE_BYTES
        for line in range(first, last + 1):
            if line not in ready:
                self._read(line)
            if ready[line] - 1 > self.time:  # one cycle is the ordinary fetch
                self.time = ready[line] - 1
        if last + 1 not in ready:
            self._read(last + 1)
        if now.is_literal:
            self._free = max(self.time, self._free) + FLASH_READ_CYCLES_2WS
            cycles += self._free - self.time - 1
        self.time += cycles

    @property
    def state(self) -> tuple[int, tuple[tuple[int, int], ...]]:
        """When it is free, and its lines with their arrival, counted from now."""
        lines = tuple((line, max(0, arrival - self.time)) for line, arrival in self._ready.items())
        return max(0, self._free - self.time), lines

    def restore(self, free: int, lines: tuple[tuple[int, int], ...]) -> None:
        self.time, self._free, self._ready = 0, free, dict(lines)


class _CrcUnit:
    """The CRC unit: a word keeps it busy for 4 cycles (RM0008 4.2), in which a store to it waits."""

    def __init__(self) -> None:
        self._free = 0

    def busy(self, time: int) -> int:
        """Cycles from `time` on in which a store waits."""
        return max(0, self._free - time)

    def restore(self, busy: int) -> None:
        self._free = busy

    def wait(self, time: int) -> int:
        """Cycles that a store at `time` waits."""
        waits = self.busy(time)
        self._free = time + waits + CRC_UNIT_CYCLES
        return waits


class Step(NamedTuple):
    """One executed instruction: its cycles, and the growth of the stack after it, in bytes."""

    instruction: Instruction
    cycles: int
    cycles_2ws: int
    stack: int


State = tuple[int, tuple[tuple[int, int], ...], int, int]
"""The state that the cost of the next instructions depends on, relative to the present: when the flash is free, its
lines with their arrival, and when the CRC unit is free at zero and at two wait states; cycles."""


class Pipeline:
    """The cost of a path that is given in consecutive pieces. unit_writes: addresses of the stores to the CRC unit."""

    def __init__(self, unit_writes: Container[int] = ()) -> None:
        self._flash, self._unit, self._unit_2ws = _Flash(), _CrcUnit(), _CrcUnit()
        self._unit_writes, self._cycles, self._depth = unit_writes, 0, 0

    @property
    def state(self) -> State:
        return (*self._flash.state, self._unit.busy(self._cycles), self._unit_2ws.busy(self._flash.time))

    def restore(self, state: State) -> None:
        """Begin anew, at time 0 and without a stack, in this state."""
        self._flash.restore(*state[:2])
        self._cycles = self._depth = 0
        self._unit.restore(state[2])
        self._unit_2ws.restore(state[3])

    def steps(
        self, piece: Sequence[Instruction], before: Instruction | None = None, behind: Instruction | None = None
    ) -> Iterator[Step]:
        """Steps of a piece. before, behind: the instructions around it; None: the caller's."""
        flash = self._flash
        for index, now in enumerate(piece):
            after = piece[index + 1] if index + 1 < len(piece) else behind
            taken = after is None or after.address != now.address + now.size
            took, begun_2ws = instruction_cycles(now, before, taken, after), flash.time
            before = now
            waits, waits_2ws = 0, 0
            if now.address in self._unit_writes:
                waits, waits_2ws = self._unit.wait(self._cycles), self._unit_2ws.wait(flash.time)
            self._cycles += took + waits
            flash.execute(now, took + waits_2ws)
            self._depth += now.stack_change
            yield Step(now, took + waits, flash.time - begun_2ws, -self._depth)


def path_steps(path: Sequence[Instruction], unit_writes: Container[int] = ()) -> Iterator[Step]:
    """Steps of a path that ends with the return to the caller. unit_writes: addresses of the stores to the CRC unit."""
    return Pipeline(unit_writes).steps(path)


def steps_cost(steps: Sequence[Step]) -> Cost:
    """Total cost of the steps."""
    cycles = cycles_2ws = stack = 0
    for step in steps:
        cycles += step.cycles
        cycles_2ws += step.cycles_2ws
        if step.stack > stack:
            stack = step.stack
    return Cost(len(steps), cycles, cycles_2ws, stack)


def path_cost(path: Sequence[Instruction], unit_writes: Container[int] = ()) -> Cost:
    """Cost of a path that ends with the return to the caller. unit_writes: addresses of the stores to the CRC unit."""
    return steps_cost(list(path_steps(path, unit_writes)))

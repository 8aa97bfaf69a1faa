"""A debugger's hold on the simulated chip: it stops before an instruction or behind an access, makes one instruction,
and reads and writes registers and memory. It adds no time and no effect of its own: a program that is stopped a
thousand times does in the same tick what it does in a run of its own.

Breakpoints are hooks of Unicorn at single addresses: nothing is written to the flash, and a machine that is not held
has none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from unicorn import UC_HOOK_CODE, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE
from unicorn.arm_const import (
    UC_ARM_REG_BASEPRI,
    UC_ARM_REG_CONTROL,
    UC_ARM_REG_FAULTMASK,
    UC_ARM_REG_LR,
    UC_ARM_REG_MSP,
    UC_ARM_REG_PC,
    UC_ARM_REG_PRIMASK,
    UC_ARM_REG_PSP,
    UC_ARM_REG_R0,
    UC_ARM_REG_SP,
    UC_ARM_REG_XPSR,
)

from plumb.f103.core.bus import Bus, SimulationError
from plumb.f103.core.cpu import FLASH_BASE, RAM_BASE, SYSTEM_BASE, Cpu
from plumb.f103.core.program_fault import ProgramFault
from plumb.f103.core.timeline import TICKS_PER_US, Timeline
from plumb.f103.peripherals.gpio import Gpio
from plumb.f103.peripherals.tim import Pwm

REGISTERS = {
    **{f"r{number}": UC_ARM_REG_R0 + number for number in range(13)},
    "sp": UC_ARM_REG_SP,
    "lr": UC_ARM_REG_LR,
    "pc": UC_ARM_REG_PC,
    "xpsr": UC_ARM_REG_XPSR,
    "msp": UC_ARM_REG_MSP,
    "psp": UC_ARM_REG_PSP,
    "primask": UC_ARM_REG_PRIMASK,
    "basepri": UC_ARM_REG_BASEPRI,
    "faultmask": UC_ARM_REG_FAULTMASK,
    "control": UC_ARM_REG_CONTROL,
}
"""By the names of gdb, in its order."""
SOFTWARE, HARDWARE, WRITE, READ, ACCESS = range(5)
"""Kinds of points, as gdb numbers them. Both kinds of breakpoints are the same here."""
WATCHED = {WRITE: "watch", READ: "rwatch", ACCESS: "awatch"}
LONGEST_TICKS = 1000 * TICKS_PER_US
"""A debugger that asks for a stop waits no longer than this, in simulated time."""


class Active(Protocol):
    """The NVIC. active: exceptions, the innermost last."""

    active: list[int]


class Chip(Protocol):
    """The machine, as a debugger sees it."""

    warnings: list[str]
    program_faults: list[ProgramFault]
    cpu: Cpu

    @property
    def bus(self) -> Bus: ...
    @property
    def nvic(self) -> Active: ...
    @property
    def timeline(self) -> Timeline: ...
    @property
    def ports(self) -> list[Gpio]: ...
    @property
    def now(self) -> int: ...
    @property
    def now_us(self) -> float: ...
    def pwm(self, pin: str, /) -> Pwm: ...
    def reset(self) -> None: ...


class Point(NamedTuple):
    """A breakpoint or a watchpoint. size: bytes that are watched."""

    kind: int
    address: int
    size: int


class Stop(NamedTuple):
    """Why the machine stands: break, watch, rwatch, awatch, step, fault or asked. address: of the access."""

    why: str
    address: int = 0


class Operator(Protocol):
    """Whoever stops machines.

    points: those that are set; a new object when they change. attached: somebody is there.
    """

    @property
    def points(self) -> frozenset[Point]: ...
    @property
    def attached(self) -> bool: ...
    def wants_stop(self) -> bool:
        """Whether to stand still now. Called before every step."""
        ...

    def stand(self, hold: DebugHold, stop: Stop) -> bool:
        """Returns when the machine is to go on; True: for one instruction."""
        ...


class DebugHold:
    """The hold on one machine. advance: makes a step of the machine, up to a time."""

    def __init__(self, machine: Chip, advance: Callable[[int], None], operator: Operator) -> None:
        self.machine, self._advance, self._operator = machine, advance, operator
        self._points: frozenset[Point] = frozenset()
        self._hooks: list[int] = []
        self._hit: Stop | None = None
        self._stepping = self._made = self._slept = False
        self._depth = 0
        self._exempt: int | None = None

    # Time

    def step(self, until: int) -> None:
        """What `Machine._step` does, and a stop where one is due."""
        operator = self._operator
        if operator.wants_stop():
            self._stand(Stop("asked"))
        self._follow_points()
        if not operator.attached:
            self._advance(until)
            return
        self.machine.cpu.loops_at_once = not self._points
        faults, failed = len(self.machine.program_faults), None
        try:
            if self._stepping:
                self._step_on(until)
            else:
                self._advance(min(until, self.machine.cpu.base + LONGEST_TICKS))
        except SimulationError as error:
            failed = error
        if len(self.machine.program_faults) > faults:  # it goes on as on silicon, in the handler
            self._hit = failed = None
        if failed is not None or len(self.machine.program_faults) > faults:
            self._hit = Stop("fault")
        if self._hit is not None:
            stop, self._hit = self._hit, None
            self._stand(stop)
        if failed is not None:
            raise failed

    def _stand(self, stop: Stop) -> None:
        self._stepping = self._operator.stand(self, stop)
        self._made = self._slept = False
        self._depth = len(self.machine.nvic.active)

    def _step_on(self, until: int) -> None:
        """One instruction of the code that stood; exceptions that come first, or that it makes, run to their end."""
        cpu = self.machine.cpu
        inside, before, base = self._inside, cpu.instructions, cpu.base
        one = not inside and not (self._slept and self.machine.timeline.next > base)
        self._exempt = None if inside else cpu.pc
        self._advance(min(until, base + (1 if one else LONGEST_TICKS)))
        self._exempt = None
        # A core that sleeps lets the time pass, at first by one tick, then up to the event that wakes it.
        self._slept = not inside and cpu.instructions == before and cpu.base > base and not self._inside
        self._made = self._made or (not inside and cpu.instructions > before)
        if self._made and not self._inside and self._hit is None:
            self._hit = Stop("step")

    @property
    def _inside(self) -> bool:
        """Whether an exception has interrupted the code that stood."""
        return len(self.machine.nvic.active) > self._depth

    # Points

    def _follow_points(self) -> None:
        """Set the hooks of the operator's points."""
        if self._points is self._operator.points:
            return
        self._points = self._operator.points
        uc = self.machine.cpu.uc
        for hook in self._hooks:
            uc.hook_del(hook)
        self._hooks = [self._hook(point) for point in self._points]
        self.machine.cpu.loops_at_once = not self._points
        self.machine.cpu.forget_code()  # it was translated with the old hooks

    def _hook(self, point: Point) -> int:
        uc, last = self.machine.cpu.uc, point.address + max(1, point.size) - 1
        if point.kind in (SOFTWARE, HARDWARE):
            return int(uc.hook_add(UC_HOOK_CODE, self._on_code, None, point.address, point.address))
        kinds = {WRITE: UC_HOOK_MEM_WRITE, READ: UC_HOOK_MEM_READ, ACCESS: UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE}
        return int(uc.hook_add(kinds[point.kind], self._on_access, WATCHED[point.kind], point.address, last))

    def _on_code(self, _uc: object, address: int, _size: int, _data: object) -> None:
        cpu = self.machine.cpu
        if not (address == self._exempt and cpu.at_first) and cpu.stop_before():
            self._hit = Stop("break", address)

    def _on_access(self, _uc: object, _access: int, address: int, _size: int, _value: int, why: str) -> None:
        self._hit = Stop(why, address)
        self.machine.cpu.end_slice()

    # Registers and memory

    def register(self, name: str) -> int:
        """Its present value, 32 bits. name: of REGISTERS."""
        cpu = self.machine.cpu
        own = {"pc": cpu.pc, "sp": cpu.stack}
        return own[name] if name in own else int(cpu.uc.reg_read(REGISTERS[name])) & 0xFFFFFFFF

    def set_register(self, name: str, value: int) -> None:
        cpu = self.machine.cpu
        if name == "pc":
            cpu.pc = value & ~1
            return
        cpu.uc.reg_write(REGISTERS[name], value)
        cpu.take_over()

    def _memory(self, address: int) -> tuple[memoryview, int] | None:
        """The memory at an address, and the place in it."""
        cpu = self.machine.cpu
        for base, memory in ((RAM_BASE, cpu.ram), (FLASH_BASE, cpu.flash), (0, cpu.flash), (SYSTEM_BASE, cpu.system)):
            if base <= address < base + len(memory):
                return memory, address - base
        return None

    def read(self, address: int, size: int) -> bytes:
        """Up to `size` bytes, fewer where memory ends. A register is read as the program would read it, but for what
        its reading does: that is left out."""
        found, warnings = self._memory(address), self.machine.warnings
        if found is not None:
            memory, place = found
            return bytes(memory[place : place + size])
        out, first, said = b"", address & ~3, len(warnings)
        while len(out) < address - first + size:
            word = self.machine.bus.peek(first + len(out))
            if word is None:
                break
            out += word.to_bytes(4, "little")
        del warnings[said:]
        return out[address - first :][:size]

    def write(self, address: int, data: bytes) -> bool:
        """Write to RAM, or to registers as the program would, in words where they fit. False where it cannot be: the
        flash holds the image, and a debugger does not change it."""
        found = self._memory(address)
        if found is not None:
            memory, place = found
            if memory is not self.machine.cpu.ram or place + len(data) > len(memory):
                return False
            memory[place : place + len(data)] = data
            self.machine.cpu.forget_code()  # which may lie there
            return True
        try:
            while data:
                size = next(size for size in (4, 2, 1) if not address % size and len(data) >= size)
                self.machine.bus.write(address, size, int.from_bytes(data[:size], "little"))
                address, data = address + size, data[size:]
        except SimulationError:
            return False
        return True

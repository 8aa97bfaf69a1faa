"""The peripheral bus: maps addresses to registers of peripherals, and carries out accesses.

A peripheral lists its registers (RM0008: name, offset, reset value, writable bits). A register without a method of its
own is plain storage; methods `read_NAME` and `write_NAME` give it behaviour. An access to a register that is not
modelled stops the simulation and reports its address, so that nothing is silently ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from plumb.errors import ExitCode, PlumbError

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu


class SimulationError(PlumbError):
    """The firmware did something the virtual board does not model, or that silicon does not allow."""

    exit_code = ExitCode.LINK_TROUBLE


class Register(NamedTuple):
    name: str
    offset: int
    reset: int = 0
    writable: int = 0xFFFFFFFF


class Peripheral:
    """One block of registers. `clocked` follows its enable bit in RCC: without a clock it reads 0 and ignores writes.
    Where reading a register has an effect, `peek_NAME` gives its value without one, for a debugger.

    Every attribute is state that a snapshot keeps (snapshot.py), unless the class names it in WIRING.
    """

    REGISTERS: ClassVar[tuple[Register, ...]] = ()
    NARROW: ClassVar[str] = "replicate"
    """8 and 16 bit writes: 'replicate' over the word (APB bridge), 'merge' into it (core), 'refuse'."""

    def __init__(self, machine: Mcu, name: str, base: int) -> None:
        self.machine = machine
        self.name = name
        self.base = base
        self.clocked = True
        for register in self.REGISTERS:
            setattr(self, register.name, register.reset)

    def reset(self) -> None:
        """Set all registers to their reset values; a peripheral also cancels its planned events here."""
        for register in self.REGISTERS:
            setattr(self, register.name, register.reset)

    def switch_clock(self, on: bool) -> None:
        """RCC switches the clock of this peripheral on or off."""
        self.clocked = on

    def clock_changing(self, now: int) -> None:
        """The bus clock is about to change at `now`: bring counters up to date with the old clock."""

    def clock_changed(self, now: int) -> None:
        """The bus clock has changed: plan the coming events again."""

    def plain_reader(self, register: Register) -> Callable[[], int]:
        values, name = self.__dict__, register.name
        return lambda: int(values[name])

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        values, name, mask = self.__dict__, register.name, register.writable

        def write(value: int) -> None:
            values[name] = (values[name] & ~mask) | (value & mask)

        return write


class Bus:
    """The registers by address, and the two callbacks of the core for reads and writes."""

    WIRING = frozenset({"readers", "writers", "peekers"})

    def __init__(self, machine: Mcu) -> None:
        self.machine = machine
        self.readers: dict[int, tuple[Peripheral, Callable[[], int]]] = {}
        self.writers: dict[int, tuple[Peripheral, Callable[[int], None]]] = {}
        self.peekers: dict[int, tuple[Peripheral, Callable[[], int]]] = {}
        self.peripherals: list[Peripheral] = []
        self.lacking: list[Peripheral] = []
        """Those that other parts of the family have."""

    def attach(self, peripheral: Peripheral) -> None:
        self.peripherals.append(peripheral)
        for register in peripheral.REGISTERS:
            address = peripheral.base + register.offset
            read = getattr(peripheral, "read_" + register.name, None) or peripheral.plain_reader(register)
            write = getattr(peripheral, "write_" + register.name, None) or peripheral.plain_writer(register)
            self.readers[address] = (peripheral, read)
            self.writers[address] = (peripheral, write)
            self.peekers[address] = (peripheral, getattr(peripheral, "peek_" + register.name, read))

    def read(self, address: int, size: int) -> int:
        found = self.readers.get(address & ~3)
        if found is None:
            raise SimulationError(self._nobody("read from", address))
        peripheral, read = found
        if not peripheral.clocked:
            self.machine.warn(f"{peripheral.name} is read at 0x{address:08X} while its clock is off in RCC")
            return 0
        value = read()
        if size == 4:
            return value
        return (value >> (8 * (address & 3))) & ((1 << (8 * size)) - 1)

    def peek(self, address: int) -> int | None:
        """The word that the register at `address` would give; the program notices nothing. None: no register."""
        found = self.peekers.get(address)
        if found is None:
            return None
        peripheral, read = found
        return read() & 0xFFFFFFFF if peripheral.clocked else 0

    def write(self, address: int, size: int, value: int) -> None:
        found = self.writers.get(address & ~3)
        if found is None:
            raise SimulationError(self._nobody(f"write of 0x{value:X} to", address))
        peripheral, write = found
        if not peripheral.clocked:
            self.machine.warn(f"{peripheral.name} is written at 0x{address:08X} while its clock is off in RCC")
            return
        if size != 4:
            value = self._widen(peripheral, address, size, value)
        write(value & 0xFFFFFFFF)

    def _widen(self, peripheral: Peripheral, address: int, size: int, value: int) -> int:
        if peripheral.NARROW == "refuse":
            raise SimulationError(f"{8 * size} bit write to {peripheral.name} at 0x{address:08X}: 32 bits only")
        value &= (1 << (8 * size)) - 1
        if peripheral.NARROW == "replicate":
            return value * (0x01010101 if size == 1 else 0x00010001)
        shift = 8 * (address & 3)
        old = self.readers[address & ~3][1]()
        return (old & ~(((1 << (8 * size)) - 1) << shift)) | (value << shift)

    def _nobody(self, action: str, address: int) -> str:
        for lacking in self.lacking:
            if lacking.base <= address < lacking.base + 0x400:
                lacked = f"{lacking.name}, which a {self.machine.part.name} does not have"
                return f"{action} 0x{address:08X}: {lacked} ({self.machine.where()})"
        below = [p for p in self.peripherals if p.base <= address < p.base + 0x400]
        place = f"{below[0].name} offset 0x{address - below[0].base:02X}" if below else "no modelled peripheral"
        return f"{action} 0x{address:08X} ({place}): this register is not modelled ({self.machine.where()})"

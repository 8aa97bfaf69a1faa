"""Register model of a sensor chip on I2C or SPI: it samples a source by its own clock; with fault injection.

    gyro = Itg3205(machine, lambda t_s: (0.0, 12.5, 0.0))
    machine.i2c_bus.slaves.append(gyro)
    gyro.answers = False            # off the bus: NACK

The source is a function: simulated seconds -> physical value of each axis, in the sensor's unit, noise included. It is
called once for every sample of the chip, in order of time, with the instant of that sample.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

from plumb.f103.core.timeline import TICKS_PER_S

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

DATA_BYTES = 6
Source = Callable[[float], tuple[float, float, float]]


class Chip(ABC):
    """A sensor chip. address: 7 bits, on I2C. Fault injection: answers, identity, frozen; brown_out().

    on_read(time_s, counts): called when the sample taken at time_s is read over the bus. The six data registers do not
    change during one access: the data sheet of the ADXL345 states it for reads of several bytes; for the ITG-3205 it is
    assumed.
    """

    NAME: ClassVar[str]
    SIZE: ClassVar[int]
    DATA: ClassVar[int]
    """First of the six data registers."""
    POWER_ON: ClassVar[dict[int, int]]
    """Registers that do not start at 0."""

    def __init__(self, machine: Machine, source: Source, address: int, identity: int) -> None:
        self.machine, self.source, self.address, self.identity = machine, source, address, identity
        self.answers = True
        self.frozen = False
        """True: the chip takes no new samples, but its bus works."""
        self.clock_error = 0.0
        """Relative error of the chip's own oscillator."""
        self.on_read: Callable[[float, tuple[int, int, int]], None] = lambda _time_s, _counts: None
        self.counts = (0, 0, 0)
        self.sampled_s = 0.0
        self._pointer: int | None = None
        self._latched = b""
        self._epoch: int | None = None
        self.registers = bytearray(self.SIZE)
        self.brown_out()

    def brown_out(self) -> None:
        """The supply fails for a moment: registers as after power-up, settings lost."""
        self.registers[:] = bytes(self.SIZE)
        for register, value in self.POWER_ON.items():
            self.registers[register] = value
        self.settings_changed()

    # What a chip defines

    @abstractmethod
    def period_s(self) -> float:
        """Time between two samples; 0 while the chip takes none."""

    @abstractmethod
    def convert(self, felt: tuple[float, float, float]) -> tuple[int, int, int]:
        """Counts of the physical values."""

    @abstractmethod
    def store(self) -> None:
        """Store `counts` in the data registers, and set the flag of new data."""

    @abstractmethod
    def written(self, register: int, value: int) -> None:
        """Handle a write to a register over the bus."""

    @abstractmethod
    def noticed(self, register: int) -> None:
        """Clear the flags that reading this register clears."""

    # Time

    def settings_changed(self) -> None:
        """Restart the sampling with the new settings, or stop it."""
        if self.period_s():
            self._plan(self.machine.now)
        else:
            self.machine.timeline.cancel(self.NAME)

    def _plan(self, now: int) -> None:
        due = now + round(self.period_s() * (1.0 - self.clock_error) * TICKS_PER_S)
        self.machine.timeline.at(self.NAME, due, self._sample)

    def _sample(self, now: int) -> None:
        self._plan(now)
        if not self.frozen:
            self.sampled_s = now / TICKS_PER_S
            self.counts = self.convert(self.source(self.sampled_s))
            self.store()

    # On a bus

    def _read(self) -> int:
        assert self._pointer is not None
        register = self._pointer % self.SIZE
        self._pointer = register + 1
        if register == self.DATA:
            self.on_read(self.sampled_s, self.counts)
            self._latched = bytes(self.registers[self.DATA : self.DATA + DATA_BYTES])
        if self.DATA <= register < self.DATA + DATA_BYTES and self._latched:
            value = self._latched[register - self.DATA]
        else:
            value = self.identity if register == 0 else self.registers[register]
        self.noticed(register)
        return value

    def _write(self, byte: int) -> None:
        assert self._pointer is not None
        register = self._pointer % self.SIZE
        self._pointer = register + 1
        self.written(register, byte)

    def begin(self, reading: bool, _now: int) -> bool:
        if not reading:
            self._pointer = None
            self._latched = b""
        return self.answers

    def write(self, byte: int, _now: int) -> bool:
        if self._pointer is None:
            self._pointer = byte
        else:
            self._write(byte)
        return self.answers

    def read(self, _now: int) -> int:
        return self._read() if self.answers and self._pointer is not None else 0xFF

    def end(self) -> None:  # noqa: B027  a chip that keeps nothing has nothing to do
        """End of an access: only the register pointer stays."""


class SpiChip(Chip):
    """A sensor chip that is also on SPI: a low select line switches it from I2C to SPI."""

    READ: ClassVar[int] = 0x80
    """Bit of the command byte."""
    SPI_MHZ: float
    SPI_MANY: ClassVar[int] = 0
    """Bit of the command byte without which an access stays at its register; 0: every access moves on."""
    _command: int | None = None

    def select(self) -> None:
        self._command = None

    def exchange(self, byte: int, _now: int) -> int:
        if self._command is None:
            self._command, self._pointer = byte, byte & ~(self.READ | self.SPI_MANY) & 0xFF
            return 0xFF
        if not self.answers:
            return 0xFF
        at = self._pointer
        answer = 0xFF
        if self._command & self.READ:
            answer = self._read()
        else:
            self._write(byte)
        if self.SPI_MANY and not self._command & self.SPI_MANY:
            self._pointer = at
        return answer

    def deselect(self) -> None:
        self._command = None

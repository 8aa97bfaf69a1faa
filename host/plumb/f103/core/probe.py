"""Interface of an instrument on the chip's pins: the models report levels and waveforms to it.

The models call these methods while `machine.probe` is set. Times are ticks. A model may report an
event a little late (a byte when it is complete) or ahead of time (bytes back to back on the UART).
"""

from __future__ import annotations

from typing import Protocol


class Waveform(Protocol):
    """A timer with PWM outputs, as `tim.Timer` offers it."""

    name: str
    zero_at: int

    @property
    def period_ticks(self) -> int: ...
    def high_ticks(self, index: int, /) -> int | None: ...


class Probe(Protocol):
    """An instrument."""

    def restarted(self, now: int, /) -> None:
        """The part was reset: bytes and frames that it was sending are cut off."""

    def pins_changed(self, now: int, /) -> None:
        """The level of a pin may have changed."""

    def uart(self, line: str, start: int, byte_ticks: int, data: bytes, /) -> None:
        """Bytes back to back on TX or RX."""

    def can(self, start: int, bit_ticks: int, levels: str, from_board: bool, /) -> None:
        """A frame on the bus, as levels of its bits."""

    def i2c(self, what: str, end: int, clock_ticks: int, byte: int, acknowledged: bool, /) -> None:
        """A `start`, `byte` or `stop` on the I2C bus that is complete at `end`."""

    def spi(self, end: int, byte_ticks: int, out: int, answer: int, /) -> None:
        """A byte in both directions, complete at `end`."""

    def timer(self, timer: Waveform, until: int, /) -> None:
        """The outputs of a timer had their present settings up to this time."""

    def volts(self, pin: str, time: int, volts: float, /) -> None:
        """A conversion sampled these volts."""

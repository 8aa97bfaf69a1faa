"""External interrupts (RM0008 chapter 10): edges of sixteen pins, each of the port that AFIO_EXTICR selects, and of
three lines inside.

An edge sets its bit in PR whether or not IMR lets it interrupt. Not modelled: events (EMR), which wake a core that
waits by WFE, and the lines of the voltage detector, the clock's alarm and USB, which rise by SWIER alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

PINS, LINES = 0xFFFF, 0x7FFFF
INTERRUPTS = {6: 1 << 0, 7: 1 << 1, 8: 1 << 2, 9: 1 << 3, 10: 1 << 4, 23: 0x3E0, 40: 0xFC00} | {
    1: 1 << 16,
    41: 1 << 17,
    42: 1 << 18,
}
"""Interrupt -> its lines (RM0008 10.1.2)."""


class Exti(Peripheral):
    REGISTERS = (
        Register("imr", 0x00, 0, LINES),
        Register("emr", 0x04, 0, LINES),
        Register("rtsr", 0x08, 0, LINES),
        Register("ftsr", 0x0C, 0, LINES),
        Register("swier", 0x10, 0, LINES),
        Register("pr", 0x14, 0, LINES),
    )
    NARROW = "merge"
    imr: int
    rtsr: int
    ftsr: int
    swier: int
    pr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "EXTI", 0x40010400)
        self.high = 0
        """Levels of the lines that wait for an edge, as they were last."""

    def reset(self) -> None:
        super().reset()
        self.high = 0
        self._request()

    def pins_changed(self) -> None:
        """A level, or the port of a line, may have changed."""
        waiting = (self.rtsr | self.ftsr) & PINS
        if not waiting:
            return
        high = self._levels(waiting)
        self.pr |= high & ~self.high & self.rtsr | self.high & ~high & self.ftsr
        self.high = high
        self._request()

    def _levels(self, lines: int) -> int:
        """Levels of these lines; a pin that floats is low."""
        ports = [port.read_idr() for port in self.machine.ports]
        selects = self.machine.afio.line_ports()
        return sum(1 << line for line in range(16) if lines >> line & 1 and ports[selects[line]] >> line & 1)

    def _request(self) -> None:
        for interrupt, lines in INTERRUPTS.items():
            self.machine.nvic.set_line(interrupt, bool(self.pr & self.imr & lines))

    def write_imr(self, value: int) -> None:
        self.imr = value & LINES
        self._request()

    def write_emr(self, value: int) -> None:
        if value & LINES:
            raise SimulationError(
                f"EXTI_EMR = 0x{value:X}: events are not modelled, interrupts are ({self.machine.where()})"
            )

    def write_rtsr(self, value: int) -> None:
        self.rtsr = value & LINES
        self._select()

    def write_ftsr(self, value: int) -> None:
        self.ftsr = value & LINES
        self._select()

    def _select(self) -> None:
        """A line that begins to wait has had no edge yet."""
        self.high = self._levels((self.rtsr | self.ftsr) & PINS)

    def write_swier(self, value: int) -> None:
        """A bit that rises sets that of PR where IMR lets it interrupt."""
        rising = value & ~self.swier & LINES
        self.swier |= rising
        self.pr |= rising & self.imr
        self._request()

    def write_pr(self, value: int) -> None:
        """Ones clear, in SWIER, too."""
        self.pr &= ~value
        self.swier &= ~value
        self._request()

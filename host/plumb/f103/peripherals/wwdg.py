"""Window watchdog (RM0008 chapter 20): a 7-bit counter of PCLK1 / 4096 / 2^WDGTB that resets the part.

The counter runs down freely, enabled or not. Once WDGA is set, only a reset clears it, and the part resets when the
counter leaves 0x40 (bit T6 falls), when it is written with T6 clear, or when it is written above the window.
Reaching 0x40 sets EWIF, whether or not EWI lets it interrupt. The divider runs on through a reload, so the first step
after one comes up to a whole step early.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

WDGA, T6, COUNTER = 0x80, 0x40, 0x7F
WINDOW, WDGTB_SHIFT, EWI = 0x7F, 7, 0x200
EWIF = 1
INTERRUPT = 0
DIVIDER = 4096
LAST = 0x40
"""The last count before the reset."""


class Wwdg(Peripheral):
    REGISTERS = (
        Register("cr", 0x00, 0x7F, 0xFF),
        Register("cfr", 0x04, 0x7F, 0x3FF),
        Register("sr", 0x08, 0, 1),
    )
    cr: int
    cfr: int
    sr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "WWDG", 0x40002C00)
        self._settled = self._epoch = self._phase = 0

    def reset(self) -> None:
        super().reset()
        self.clocked = False  # a reset clears the enable bit in RCC, too
        self._settled = self._epoch = self.machine.now
        self.machine.timeline.cancel("wwdg")
        self.machine.nvic.set_line(INTERRUPT, False)

    # Counting

    def switch_clock(self, on: bool) -> None:
        """Without a clock the counter stands still."""
        if on == self.clocked:
            return
        now = self.machine.now
        self._settle(now)
        self._epoch = self._settled = now
        if not on and self.cr & WDGA:
            self.machine.warn("RCC takes the window watchdog's clock while it runs")
        super().switch_clock(on)
        self._plan()

    @property
    def step_ticks(self) -> int:
        """Time between two counts."""
        return self.machine.rcc.pclk1_ticks * (DIVIDER << (self.cfr >> WDGTB_SHIFT & 3))

    def _steps(self, time: int) -> int:
        return (time - self._epoch) // self.step_ticks

    def _settle(self, now: int) -> None:
        """Count down to `now`."""
        if not self.clocked:
            return
        before = self.cr & COUNTER
        steps = self._steps(now) - self._steps(self._settled)
        self._settled = now
        self.cr = self.cr & WDGA | (before - steps) & COUNTER
        if steps >= (before - LAST) % (COUNTER + 1) > 0:
            self._reached_last()

    def _reached_last(self) -> None:
        self.sr |= EWIF
        self._look_at_line()

    def _look_at_line(self) -> None:
        self.machine.nvic.set_line(INTERRUPT, bool(self.sr & EWIF and self.cfr & EWI))

    def _plan(self) -> None:
        """Schedule the next event: the count 0x40, or the reset one step later."""
        timeline, counter = self.machine.timeline, self.cr & COUNTER
        if not self.clocked or not (self.cr & WDGA or self.cfr & EWI):
            timeline.cancel("wwdg")
            return
        steps = (counter - LAST) % (COUNTER + 1) or 1
        timeline.at("wwdg", self._epoch + (self._steps(self._settled) + steps) * self.step_ticks, self._count)

    def _count(self, time: int) -> None:
        self._settle(time)
        if self.cr & WDGA and not self.cr & T6:
            self.machine.request_reset("wwdg")
        else:
            self._plan()

    def clock_changing(self, now: int) -> None:
        self._settle(now)
        if self.clocked:
            self._phase = (now - self._epoch) % self.step_ticks // self.machine.rcc.pclk1_ticks

    def clock_changed(self, now: int) -> None:
        self._settled = now
        self._epoch = now - self._phase * self.machine.rcc.pclk1_ticks
        self._plan()

    # Registers

    def read_cr(self) -> int:
        self._settle(self.machine.now)
        return self.cr

    def write_cr(self, value: int) -> None:
        self._settle(self.machine.now)
        above_window = self.cr & COUNTER > self.cfr & WINDOW
        was_on = self.cr & WDGA
        self.cr = was_on | value & (WDGA | COUNTER)
        if self.cr & WDGA and (not value & T6 or (was_on and above_window)):
            self.machine.request_reset("wwdg")
        self._plan()

    def write_cfr(self, value: int) -> None:
        now = self.machine.now
        self._settle(now)
        self.cfr = value & 0x3FF | self.cfr & EWI  # cleared by a reset alone
        self._settled = now
        self._look_at_line()
        self._plan()

    def read_sr(self) -> int:
        self._settle(self.machine.now)
        return self.sr

    def write_sr(self, value: int) -> None:
        self._settle(self.machine.now)
        self.sr &= value
        self._look_at_line()

"""TIM2 for Hall sensors (RM0008 15.3.5, 15.3.12): the exclusive or of three inputs is filtered, and its edges are
captured on channel 1; or as the pulse output or the encoder that every general-purpose timer is. Not modelled: other
captures and slave modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import SimulationError
from plumb.f103.peripherals.tim import CC1E, CC1I, CC1OF, CEN, ENCODER_INPUTS, FILTER_BITS, FILTERS, UIE, UIF, Timer

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

TI1S, TS_TI1F_ED, CC1S_TRC = 0x80, 4 << 4, 3
PINS = ("PA0", "PA1", "PA2")
REMAPPED_PINS = ("PA15", "PB3", "PB10")


class Tim2(Timer):
    def __init__(self, machine: Mcu) -> None:
        self.level = False
        super().__init__(machine, "TIM2", 0x40000000, 28)

    def reset(self) -> None:
        super().reset()
        self.machine.timeline.cancel("TIM2 filter")
        self.level = False
        """TI1 after its filter."""

    @property
    def pins(self) -> tuple[str, str, str]:
        remap = self.machine.afio.mapr >> 8 & 3
        if remap not in (0, 3):
            raise SimulationError(f"AFIO_MAPR: TIM2 remapped by {remap} is not modelled")
        return REMAPPED_PINS if remap else PINS

    def _input(self) -> bool:
        levels = [bool(self.machine.pin(pin)) for pin in self.pins]
        return levels[0] ^ levels[1] ^ levels[2]

    @property
    def filter_ticks(self) -> int:
        divider, samples = FILTERS[self.ccmr1 >> 4 & 15]
        return self.machine.rcc.timer1_ticks * (1 << (self.cr1 >> 8 & 3)) * divider * samples

    def pins_changed(self) -> None:
        """A new level takes effect when it lasts as long as the filter requires."""
        if not (self.clocked and self.cr1 & CEN and self.cr2 & TI1S):
            return
        timeline, now = self.machine.timeline, self.machine.now
        if self._input() == self.level:
            timeline.cancel("TIM2 filter")
        else:
            timeline.at("TIM2 filter", now + self.filter_ticks, self._edge)

    def _edge(self, time: int) -> None:
        self.level = not self.level
        if self.ccer & CC1E and self.ccmr1 & 3 == CC1S_TRC and self.smcr & 0x70 == TS_TI1F_ED:
            self.settle(time)
            self.ccr1 = self.count(time)
            self.sr |= CC1I | (CC1OF if self.sr & CC1I else 0)
            self._plan()

    def _plan(self) -> None:
        super()._plan()
        due = self.sr & self.dier & (UIF | CC1I)
        self.machine.nvic.set_line(self.interrupt, bool(due))

    def write_cr1(self, value: int) -> None:
        starts = value & ~self.cr1 & CEN
        super().write_cr1(value)
        if starts:
            self.level = self._input()

    def write_smcr(self, value: int) -> None:
        if value & ~TS_TI1F_ED:
            super().write_smcr(value)
        self.smcr = value

    def write_dier(self, value: int) -> None:
        if value & ~(UIE | CC1I):
            raise SimulationError(f"TIM2_DIER = 0x{value:04X}: only update and channel 1 are modelled")
        self.settle(self.machine.now)
        self.dier = value
        self._plan()

    def write_ccmr1(self, value: int) -> None:
        captures = value & 0x0303
        encodes = value & ~FILTER_BITS == ENCODER_INPUTS
        if captures and not encodes and value & ~0xF0 != CC1S_TRC:
            raise SimulationError(f"TIM2_CCMR1 = 0x{value:04X}: only the capture of channel 1 from TRC is modelled")
        self.ccmr1 = value

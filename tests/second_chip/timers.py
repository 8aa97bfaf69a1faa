"""TIM2 to TIM4 and TIM1 (RM0008 14.4, 15.4): update events, preloaded PWM, Hall capture, encoders, complementary
outputs."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

from second_chip.block import Block, Layout
from second_chip.clocks import UNITS_HZ

if TYPE_CHECKING:
    from second_chip.chip import Chip

UIF, CC1IF, BIF, CC1OF = 1, 1 << 1, 1 << 7, 1 << 9
CAPTURE_IRQ = 27
FILTER = {0: (1, 1), 3: (1, 8), 15: (32, 8)}
"""IC1F -> divider of the sampling clock, equal samples; those that a test has used."""
FIRST_IRQ = {2: 28, 3: 29, 4: 30}
ENCODER_PINS = {("A", 0): (2, 0), ("A", 1): (2, 1), ("B", 6): (4, 0), ("B", 7): (4, 1)}
"""Timer and input of a pin, without remapping (RM0008 9.3.7)."""
TI1_EDGES, TI2_EDGES = (2, 3), (1, 3)
"""Modes of SMCR.SMS in which the edges of an input count."""
COMMON = {
    0x00: ("CR1", 0, 0x3FF),
    0x04: ("CR2", 0, 0xF8),
    0x08: ("SMCR", 0, 0xFFF7),
    0x0C: ("DIER", 0, 0x5F5F),
    0x10: ("SR", 0, 0),
    0x14: ("EGR", 0, 0),
    0x18: ("CCMR1", 0, 0xFFFF),
    0x1C: ("CCMR2", 0, 0xFFFF),
    0x20: ("CCER", 0, 0x3333),
    0x24: ("CNT", 0, 0xFFFF),
    0x28: ("PSC", 0, 0xFFFF),
    0x2C: ("ARR", 0xFFFF, 0xFFFF),
    0x34: ("CCR1", 0, 0xFFFF),
    0x38: ("CCR2", 0, 0xFFFF),
    0x3C: ("CCR3", 0, 0xFFFF),
    0x40: ("CCR4", 0, 0xFFFF),
}


class Timer(Block):
    """Counts up; active: the registers in force where what the firmware writes is preloaded."""

    LAYOUT: ClassVar[Layout] = COMMON

    def __init__(self, chip: Chip, number: int) -> None:
        self.number = number
        if number > 1:
            self.CLOCK = ("APB1ENR", number - 2)
        super().__init__(chip)

    def reset(self) -> None:
        super().reset()
        self.active = {name: self.value[name] for name in ("PSC", "ARR", "CCR1", "CCR2", "CCR3", "CCR4")}
        self._count_from, self._count_at = 0, self.chip.now
        self._generation = getattr(self, "_generation", 0) + 1
        self._inputs = [0, 0]
        self._looked = [count + 1 for count in getattr(self, "_looked", (0, 0))]

    # ---- counting ----

    def _cycle(self) -> int:
        return (self.active["PSC"] + 1) * self.chip.rcc.timer1()

    def _running(self) -> bool:
        """By the clock; an encoder's edges take its place (15.3.12)."""
        return bool(self.value["CR1"] & 1) and self.active["ARR"] > 0 and not 1 <= self.value["SMCR"] & 7 <= 3

    def _schedule(self) -> None:
        self._generation += 1
        if self._running():
            generation = self._generation
            left = (self.active["ARR"] + 1 - self.read_CNT()) * self._cycle()
            self.chip.after(max(left, 1), lambda: self._overflow(generation))

    def _overflow(self, generation: int) -> None:
        if generation != self._generation:
            return
        self._count_from, self._count_at = 0, self.chip.now
        if not self.value["CR1"] & 2:  # UDIS: the shadow registers keep their values, and no event is raised
            self._update()
        self._schedule()

    def _update(self) -> None:
        self.active = {name: self.value[name] for name in self.active}
        self.value["SR"] |= UIF
        self._raise()
        if self.number == 3 and self.bit("CR2", 4, 3) == 2:
            self.chip.adc.trigger()

    def _raise(self) -> None:
        if self.number in FIRST_IRQ:
            self.chip.nvic.line(FIRST_IRQ[self.number], self.value["SR"] & self.value["DIER"] & 0x5F != 0)

    def read_CNT(self) -> int:
        if not self._running():
            return self._count_from
        return (self._count_from + (self.chip.now - self._count_at) // self._cycle()) % (self.active["ARR"] + 1)

    # ---- registers ----

    def write_CR1(self, value: int) -> None:
        count = self.read_CNT()
        before = self.value["CR1"]
        self.value["CR1"] = value & 0x3FF
        if (value ^ before) & 1:
            self._count_from, self._count_at = count, self.chip.now
            self._schedule()
            for place in (0, 1):
                self.encoder_level(place)

    def write_CNT(self, value: int) -> None:
        self._count_from, self._count_at = value & 0xFFFF, self.chip.now
        self._schedule()

    def write_ARR(self, value: int) -> None:
        count = self.read_CNT()
        self.value["ARR"] = value & 0xFFFF
        if not self.value["CR1"] & 0x80:
            self._count_from, self._count_at = count, self.chip.now
            self.active["ARR"] = value & 0xFFFF
            self._schedule()

    def _write_compare(self, channel: int, value: int) -> None:
        name = f"CCR{channel}"
        self.value[name] = value & 0xFFFF
        mode = self.value["CCMR1" if channel < 3 else "CCMR2"] >> 8 * ((channel - 1) % 2)
        if not mode & 8:
            self.active[name] = self.value[name]

    def write_CCR1(self, value: int) -> None:
        self._write_compare(1, value)

    def write_CCR2(self, value: int) -> None:
        self._write_compare(2, value)

    def write_CCR3(self, value: int) -> None:
        self._write_compare(3, value)

    def write_CCR4(self, value: int) -> None:
        self._write_compare(4, value)

    def write_SR(self, value: int) -> None:
        self.value["SR"] &= value
        self._raise()

    def write_DIER(self, value: int) -> None:
        self.value["DIER"] = value & 0x5F5F
        self._raise()

    def read_EGR(self) -> int:
        return 0

    def write_EGR(self, value: int) -> None:
        if value & 1:
            self._count_from, self._count_at = 0, self.chip.now
            self._update()
            self._schedule()

    # ---- encoder (15.3.12) ----

    def encoder_level(self, place: int) -> None:
        """TI1 or TI2 may have another level, which counts when it lasts for the samples of its filter."""
        if not 1 <= self.value["SMCR"] & 7 <= 3:
            return
        self._looked[place] += 1
        divider, samples = FILTER[self.bit("CCMR1", 4 + 8 * place, 4)]
        sampling = self.chip.rcc.timer1() << self.bit("CR1", 8, 2)
        self.chip.after(sampling * divider * samples, partial(self._encoder_edge, place, self._looked[place]))

    def _encoder_edge(self, place: int, look: int) -> None:
        """Table 85: an edge counts up or down by its direction and the level of the other input."""
        port, pin = next(name for name, found in ENCODER_PINS.items() if found == (self.number, place))
        level = self.chip.ports[port].level(pin)
        if look != self._looked[place] or level == self._inputs[place]:
            return
        self._inputs[place] = level
        selected = self.bit("CCMR1", 0, 2) == self.bit("CCMR1", 8, 2) == 1
        if not (selected and self.clocked() and self.bit("CR1", 0)):
            return
        if self.value["SMCR"] & 7 not in (TI1_EDGES, TI2_EDGES)[place]:
            return
        rises = level ^ self.bit("CCER", 1 + 4 * place)
        other = self._inputs[1 - place] ^ self.bit("CCER", 1 + 4 * (1 - place))
        up = bool(rises) != bool(other) if place == 0 else bool(rises) == bool(other)
        self.value["CR1"] = self.value["CR1"] & ~(1 << 4) | (0 if up else 1 << 4)
        self._count_from = (self._count_from + (1 if up else -1)) % (self.active["ARR"] + 1)

    # ---- pins ----

    def pulse_us(self, channel: int) -> float | None:
        """High time of a channel in PWM mode 1; None where it is not driven."""
        mode = self.value["CCMR1" if channel < 3 else "CCMR2"] >> 8 * ((channel - 1) % 2) + 4 & 7
        if not self._running() or mode != 6 or not self.value["CCER"] >> 4 * (channel - 1) & 1:
            return None
        return self.active[f"CCR{channel}"] * self._cycle() * 1e6 / UNITS_HZ

    def frame_us(self) -> float:
        return (self.active["ARR"] + 1) * self._cycle() * 1e6 / UNITS_HZ

    def hall_edge(self) -> None:
        """An edge of channels 1 to 3, together on TI1 (TI1S), captured by channel 1 (TRC from TI1F_ED)."""
        together = self.value["CR2"] >> 7 & 1 and self.bit("SMCR", 4, 3) == 4 and self.value["CCMR1"] & 3 == 3
        if together and self.value["CCER"] & 1 and self.value["CR1"] & 1 and self.clocked():
            self.value["SR"] |= CC1IF
            self._raise()


class AdvancedTimer(Timer):
    """TIM1: preloaded output modes (CCPC, COM), main output enable and break."""

    LAYOUT: ClassVar[Layout] = COMMON | {
        0x04: ("CR2", 0, 0x7FFD),
        0x0C: ("DIER", 0, 0x7FFF),
        0x20: ("CCER", 0, 0x3FFF),
        0x30: ("RCR", 0, 0xFF),
        0x44: ("BDTR", 0, 0xFFFF),
    }
    CLOCK = ("APB2ENR", 11)

    def __init__(self, chip: Chip) -> None:
        super().__init__(chip, 1)

    def reset(self) -> None:
        super().reset()
        self.modes = self.enables = 0
        self._ti1 = 0
        self._looks = getattr(self, "_looks", 0) + 1

    # ---- input capture of channel 1 (14.3.6) ----

    def input_edge(self, level: int) -> None:
        """PA8 has another level: it counts when it lasts for the samples of the filter (14.4.7, IC1F)."""
        self._looks += 1
        look = self._looks
        divider, samples = FILTER[self.bit("CCMR1", 4, 4)]
        sampling = self.chip.rcc.timer2() << self.bit("CR1", 8, 2)
        self.chip.after(sampling * divider * samples, lambda: self._filtered(level, look))

    def _filtered(self, level: int, look: int) -> None:
        if look != self._looks or level == self._ti1:
            return
        self._ti1 = level
        captures = self.clocked() and self.bit("CCMR1", 0, 2) == 1 and self.bit("CCER", 0, 2) == 1
        if level and captures and self.bit("CR1", 0):
            self.value["CCR1"] = self.read_CNT()
            self.value["SR"] |= CC1IF | (CC1OF if self.value["SR"] & CC1IF else 0)
            self._raise()

    def read_CCR1(self) -> int:
        if self.bit("CCMR1", 0, 2):
            self.value["SR"] &= ~CC1IF
            self._raise()
        return self.value["CCR1"]

    def _raise(self) -> None:
        self.chip.nvic.line(CAPTURE_IRQ, self.value["SR"] & self.value["DIER"] & CC1IF != 0)

    # ---- bridge ----

    def _cycle(self) -> int:
        centred = 2 if self.bit("CR1", 5, 2) else 1  # up and down again
        return (self.active["PSC"] + 1) * self.chip.rcc.timer2() * centred

    def write_EGR(self, value: int) -> None:
        if value >> 5 & 1:  # COMG
            self.modes = self.value["CCMR1"] | self.value["CCMR2"] << 16
            self.enables = self.value["CCER"]
        super().write_EGR(value)

    def break_now(self) -> None:
        """Main output enable off, if the break is enabled."""
        if self.clocked() and self.bit("BDTR", 12):
            self.value["BDTR"] &= ~(1 << 15)
            self.value["SR"] |= BIF

    def _break_input(self) -> bool:
        """PB12, active low unless BKP; an open pin without a pull breaks."""
        port = self.chip.ports["B"]
        floats = port.mode(12) == 4 and 12 not in port.outside
        return floats or (port.input(12) and port.level(12) == self.bit("BDTR", 13))

    def look_at_break(self) -> None:
        if self._break_input():
            self.break_now()

    def write_SR(self, value: int) -> None:
        super().write_SR(value)
        self.look_at_break()

    def write_BDTR(self, value: int) -> None:
        """LOCK level 2 protects dead time, break and OSSR, OSSI from then on (14.4.18)."""
        lock = self.bit("BDTR", 8, 2)
        kept = (0, 0x70FF | 0x300, 0x7FFF, 0x7FFF)[lock]
        self.value["BDTR"] = self.value["BDTR"] & kept | value & 0xFFFF & ~kept
        self.look_at_break()

    def complement(self, channel: int) -> float | None:
        """Share of the time that OCxN is high, without preloaded modes (CCPC); None where the timer does not drive it
        (table 83). Enabled alone it is OCxREF, and no dead time takes part."""
        enables = self.value["CCER"] >> 4 * (channel - 1) & 5
        on = self.bit("BDTR", 15)
        if not enables or (not self.bit("BDTR", 11 if on else 10) and (not on or enables == 1)):
            return None
        if not on or enables == 1:
            return 0.0  # off-state, driven: OISxN and CCxNP are 0
        mode = self.value["CCMR1" if channel < 3 else "CCMR2"] >> 8 * ((channel - 1) % 2) + 4 & 7
        share = self.active[f"CCR{channel}"] / self.active["ARR"] if mode == 6 and self._running() else 0.0
        return min(share, 1.0) if enables == 4 else 1.0 - min(share, 1.0)

    def driven(self) -> dict[int, float | None]:
        """Share of the time that a phase's high side is on, by phase; None where both its sides are off. Empty while
        the main output is off."""
        if not self.bit("BDTR", 15):
            return {}
        shares: dict[int, float | None] = {}
        for phase in range(3):
            mode = self.modes >> 8 * phase + 4 & 7
            on = self.active[f"CCR{phase + 1}"] / (self.active["ARR"] or 1) if mode == 6 else 0.0
            shares[phase] = on if self.enables >> 4 * phase & 5 == 5 else None
        return shares

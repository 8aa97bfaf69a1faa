"""ADC1 and ADC2 (RM0008 11): scans of regular channels, by software or by TIM3's trigger, ADC1's into DMA1 channel 1.

volts: what is put on a channel; a callable is asked when its conversion ends.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from second_chip.block import Block, Layout

if TYPE_CHECKING:
    from second_chip.chip import Chip

VDDA = 3.3
SAMPLE_CYCLES_X2 = (3, 15, 27, 57, 83, 111, 143, 479)
CONVERSION_CYCLES_X2 = 25
CALIBRATION_CYCLES = 83
EOC, STRT = 2, 16
TIM3_TRGO = 4
PINS = [("A", pin) for pin in range(8)] + [("B", 0), ("B", 1)]


class Adc(Block):
    LAYOUT: ClassVar[Layout] = {
        0x00: ("SR", 0, 0),
        0x04: ("CR1", 0, 0xCFFFFF),
        0x08: ("CR2", 0, 0xFEF90F),
        0x0C: ("SMPR1", 0, 0xFFFFFF),
        0x10: ("SMPR2", 0, 0x3FFFFFFF),
        0x2C: ("SQR1", 0, 0xFFFFFF),
        0x30: ("SQR2", 0, 0x3FFFFFFF),
        0x34: ("SQR3", 0, 0x3FFFFFFF),
        0x4C: ("DR", 0, 0),
    }

    def __init__(self, chip: Chip, first: Adc | None = None) -> None:
        self.first = first
        """ADC1, whose pins this is on, too; None: it is ADC1."""
        self.CLOCK = ("APB2ENR", 9 if first is None else 10)
        super().__init__(chip)

    def reset(self) -> None:
        if not self.value:
            self.volts: dict[int, float | Callable[[], float]] = {} if self.first is None else self.first.volts
        super().reset()
        self._run = getattr(self, "_run", 0) + 1
        self._scanning = False

    def write_SR(self, value: int) -> None:
        self.value["SR"] &= value

    def write_CR2(self, value: int) -> None:
        before = self.value["CR2"]
        self.value["CR2"] = value & 0xBEF90F | before & 0xC  # CAL and RSTCAL are cleared by hardware
        run = self._run
        for bit, cycles in ((2, CALIBRATION_CYCLES), (3, 2)):
            if value >> bit & 1 and value & 1:
                self.chip.after(cycles * self.chip.rcc.adc(), partial(self._calibrated, bit, run))
        if not value & 1:
            self._run += 1
            self._scanning = False
        elif before & 1 and (value ^ before) & 0x3EF900 == 0 and not value & 0xC and not before & 0xC:
            self._start()  # ADON once more, with nothing else changed (11.12.3)
        if value & 0x500000 == 0x500000 and self.bit("CR2", 17, 3) == 7:  # SWSTART
            self._start()

    def _calibrated(self, bit: int, run: int) -> None:
        if run == self._run:
            self.value["CR2"] &= ~(1 << bit)

    def trigger(self) -> None:
        """TIM3's TRGO."""
        if self.value["CR2"] & 1 and self.value["CR2"] >> 20 & 1 and self.bit("CR2", 17, 3) == TIM3_TRGO:
            self._start()

    def _start(self) -> None:
        if self._scanning or not self.clocked():
            return
        self._scanning = True
        self.value["SR"] |= STRT
        self._convert(0, self._run)

    def _channel(self, place: int) -> int:
        return self.bit(("SQR3", "SQR2", "SQR1")[place // 6], 5 * (place % 6), 5)

    def _convert(self, place: int, run: int) -> None:
        channel = self._channel(place)
        sample = self.bit("SMPR2", 3 * channel, 3) if channel < 10 else self.bit("SMPR1", 3 * (channel - 10), 3)
        cycles_x2 = SAMPLE_CYCLES_X2[sample] + CONVERSION_CYCLES_X2
        self.chip.after(cycles_x2 * self.chip.rcc.adc() // 2, lambda: self._converted(place, run))

    def count(self, channel: int) -> int:
        """A pin that is not analog has its digital input in the way: 0, so that a wrong set-up shows."""
        if channel >= len(PINS) or self.chip.ports[PINS[channel][0]].mode(PINS[channel][1]) != 0:
            return 0
        given = self.volts.get(channel, 0.0)
        volts = given if isinstance(given, float | int) else given()
        return min(max(int(volts / VDDA * 4096), 0), 4095)

    def _converted(self, place: int, run: int) -> None:
        if run != self._run:
            return
        self.value["DR"] = self.count(self._channel(place))
        last = place == (self.bit("SQR1", 20, 4) if self.value["CR1"] & 1 << 8 else 0)
        self.value["SR"] |= EOC
        if self.value["CR2"] & 1 << 8 and self.first is None:
            self.chip.dma.request(1)
        if not last:
            self._convert(place + 1, run)
            return
        self._scanning = False
        if self.value["CR2"] & 2:
            self._start()

    def read_DR(self) -> int:
        self.value["SR"] &= ~EOC
        return self.value["DR"]


class Adc2(Adc):
    """Without dual mode, DMA, and the internal channels, which are ADC1's."""

    LAYOUT: ClassVar[Layout] = Adc.LAYOUT | {0x04: ("CR1", 0, 0xC0FFFF), 0x08: ("CR2", 0, 0x7EF80F)}

"""Ports and alternate functions (RM0008 9.2, 9.4), and the levels that the outside puts on pins."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from second_chip.block import Block, Layout
from second_chip.timers import ENCODER_PINS

if TYPE_CHECKING:
    from second_chip.chip import Chip

DEBUG_PINS = {
    ("A", 13): ((4,), 1),
    ("A", 14): ((4,), 0),
    ("A", 15): ((2, 4), 1),
    ("B", 3): ((2, 4), 0),
    ("B", 4): ((1, 2, 4), 1),
}
"""The debug port's, until AFIO_MAPR.SWJ_CFG has one of these values (table 38), and the level of its own pull (31.4.4);
JTDO, PB3, has none and floats."""

HALL_PINS = (("A", 15), ("B", 3), ("B", 10))
"""TIM2's channels 1 to 3, fully remapped."""


class Port(Block):
    """outside: level by pin number, 0 or 1; a pin that is not in it is open."""

    LAYOUT: ClassVar[Layout] = {
        0x00: ("CRL", 0x44444444, 0xFFFFFFFF),
        0x04: ("CRH", 0x44444444, 0xFFFFFFFF),
        0x08: ("IDR", 0, 0),
        0x0C: ("ODR", 0, 0xFFFF),
        0x10: ("BSRR", 0, 0),
        0x14: ("BRR", 0, 0),
    }

    def __init__(self, chip: Chip, name: str, clock_bit: int) -> None:
        self.name = name
        self.CLOCK = ("APB2ENR", clock_bit)
        self.outside: dict[int, int] = {}
        super().__init__(chip)

    def mode(self, pin: int) -> int:
        """CNF and MODE, four bits."""
        return self.value["CRL" if pin < 8 else "CRH"] >> 4 * (pin % 8) & 15

    def alternate(self, pin: int) -> bool:
        """Driven by a peripheral."""
        return self.mode(pin) & 8 != 0 and self.mode(pin) & 3 != 0

    def input(self, pin: int) -> bool:
        return self.mode(pin) & 3 == 0

    def level(self, pin: int) -> int:
        mode = self.mode(pin)
        out = self.value["ODR"] >> pin & 1
        given = self.outside.get(pin)
        freed, pull = DEBUG_PINS.get((self.name, pin), ((), 0))
        if freed and self.chip.afio.debug_port not in freed:
            return pull if given is None else given
        if mode & 3:
            if mode & 8:
                return 1 if given is None else given
            return out if not mode & 4 or out == 0 else (1 if given is None else given)  # open drain: pulled up
        if mode == 8:
            return out if given is None else given
        return 0 if mode == 0 or given is None else given

    def drive(self, pin: int, level: int) -> None:
        """The outside changes a level: Hall inputs, encoders and the break see it at once."""
        self.outside[pin] = level
        if (self.name, pin) in HALL_PINS:
            self.chip.tim2.hall_edge()
        if (self.name, pin) == ("A", 8):
            self.chip.tim1.input_edge(level)
        timer, place = ENCODER_PINS.get((self.name, pin), (0, 0))
        if timer == 2 and not self.chip.afio.bit("MAPR", 8):  # else TIM2_REMAP has moved channels 1 and 2
            self.chip.tim2.encoder_level(place)
        elif timer == 4:
            self.chip.tim4.encoder_level(place)
        self.chip.tim1.look_at_break()

    def read_IDR(self) -> int:
        return sum(self.level(pin) << pin for pin in range(16))

    def write_BSRR(self, value: int) -> None:
        self.value["ODR"] = self.value["ODR"] & ~(value >> 16) | value & 0xFFFF

    def write_BRR(self, value: int) -> None:
        self.value["ODR"] &= ~value


class Afio(Block):
    LAYOUT: ClassVar[Layout] = {0x04: ("MAPR", 0, 0x071FFFFF)}
    CLOCK = ("APB2ENR", 0)

    @property
    def debug_port(self) -> int:
        return self.bit("MAPR", 24, 3)

    def read_MAPR(self) -> int:
        """SWJ_CFG is write-only: what comes back in its place is not what was written (RM0008 9.4.2)."""
        return self.value["MAPR"] ^ 0x07000000

"""Ports and alternate functions (RM0008 chapters 8 and 9)."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register
from plumb.f103.core.timeline import TICKS_PER_US

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu


JTAG_PINS = (("GPIOA", 15), ("GPIOB", 3), ("GPIOB", 4))
"""JTDI, JTDO and NJTRST until AFIO_MAPR.SWJ_CFG frees them."""


LSE_PINS = (14, 15)
"""Pins of port C that belong to the 32 kHz crystal while RCC_BDCR.LSEON is set."""


PORTS = 5
"""A to E."""
FLOATING = 4
"""CNF:MODE of a floating input, which reset leaves."""


class Gpio(Peripheral):
    """One port. `outside[n]`: level at which pin n is driven from outside; None: not driven."""

    REGISTERS = (
        Register("crl", 0x00, 0x44444444),
        Register("crh", 0x04, 0x44444444),
        Register("idr", 0x08, 0, 0),
        Register("odr", 0x0C, 0, 0xFFFF),
        Register("bsrr", 0x10),
        Register("brr", 0x14),
        Register("lckr", 0x18, 0, 0x1FFFF),
    )
    crl: int
    crh: int
    odr: int

    def __init__(self, machine: Mcu, letter: str, base: int) -> None:
        super().__init__(machine, "GPIO" + letter, base)
        self.outside: list[bool | None] = [None] * 16
        self.rise_us: dict[int, float] = {}
        """Pin -> time that its internal pull-up needs to lift it."""
        self._pulled_at: dict[int, int] = {}

    def mode(self, pin: int) -> int:
        """The four bits CNF:MODE."""
        return ((self.crh if pin > 7 else self.crl) >> (4 * (pin & 7))) & 15

    def is_output(self, pin: int) -> bool:
        return bool(self.mode(pin) & 3)

    def is_alternate_output(self, pin: int) -> bool:
        return bool(self.mode(pin) & 3) and bool(self.mode(pin) & 8)

    def is_analog(self, pin: int) -> bool:
        return self.mode(pin) == 0

    def level(self, pin: int) -> bool | None:
        """Level of the pin: driven, by its pull resistor, or None when it floats. The program cannot read a pin that
        still belongs to the debug port."""
        if (self.name, pin) in JTAG_PINS and self.machine.afio.swj_cfg < 2:
            return None
        if self.name == "GPIOC" and pin in LSE_PINS and self.machine.rcc.bdcr & 1:
            return None
        mode = self.mode(pin)
        if mode & 3 and not mode & 8:
            high = bool(self.odr >> pin & 1)
            open_drain = mode & 4
            return self.outside[pin] if open_drain and high else high
        if self.outside[pin] is not None or mode != 8:
            return self.outside[pin]
        high = bool(self.odr >> pin & 1)
        if high and pin in self.rise_us:
            risen_at = self._pulled_at.get(pin, 0) + round(self.rise_us[pin] * TICKS_PER_US)
            return True if self.machine.now >= risen_at else None
        return high

    def _changed(self) -> None:
        self.machine.pins_changed()

    def write_crl(self, value: int) -> None:
        for pin in range(8):
            if value >> 4 * pin & 15 == 8 and self.mode(pin) != 8:
                self._pulled_at[pin] = self.machine.now
        self.crl = value
        self._changed()

    def write_crh(self, value: int) -> None:
        self.crh = value
        self._changed()

    def write_odr(self, value: int) -> None:
        self.odr = value & 0xFFFF
        self._changed()

    def read_idr(self) -> int:
        found, modes = 0, self.crh << 32 | self.crl
        for pin, outside in enumerate(self.outside):
            mode, modes = modes & 15, modes >> 4
            # nearly all pins are analog, which read 0, or floating inputs that nothing drives high, which read 0, too
            if mode and (outside or mode != FLOATING) and self.level(pin):
                found |= 1 << pin
        return found

    def write_bsrr(self, value: int) -> None:
        self.odr = (self.odr & ~(value >> 16) | value) & 0xFFFF
        self._changed()

    def write_brr(self, value: int) -> None:
        self.odr &= ~value & 0xFFFF
        self._changed()

    def read_bsrr(self) -> int:
        return 0

    def read_brr(self) -> int:
        return 0


class Afio(Peripheral):
    """Remapping. SWJ_CFG is write-only: reading it gives garbage, here from a fixed seed, so that a read-modify-write
    of MAPR loses the debug port, as on silicon; see `debug_port`."""

    REGISTERS = (
        Register("evcr", 0x00, 0, 0xFF),
        Register("mapr", 0x04),
        *(Register(f"exticr{i}", 0x04 + 4 * i, 0, 0xFFFF) for i in range(1, 5)),
    )
    mapr: int
    exticr1: int
    exticr2: int
    exticr3: int
    exticr4: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "AFIO", 0x40010000)
        self.swj_cfg = 0
        self._garbage = random.Random(0x5357)

    def reset(self) -> None:
        super().reset()
        self.swj_cfg = 0
        self._garbage = random.Random(0x5357)

    def read_mapr(self) -> int:
        return self.mapr | self._garbage.randrange(8) << 24

    def peek_mapr(self) -> int:
        return self.mapr

    def line_ports(self) -> list[int]:
        """For each of the sixteen lines of EXTI the number of the port whose pin it is: 0 is A."""
        registers = (self.exticr1, self.exticr2, self.exticr3, self.exticr4)
        return [min(register >> 4 * i & 15, PORTS - 1) for register in registers for i in range(4)]

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        write = super().plain_writer(register)

        def write_and_look(value: int) -> None:
            write(value)
            self.machine.pins_changed()

        return write_and_look if register.name.startswith("exticr") else write

    def write_mapr(self, value: int) -> None:
        self.mapr = value & 0x001FFFFF
        self.swj_cfg = (value >> 24) & 7
        self.machine.pins_changed()
        if self.swj_cfg not in (0, 1, 2, 4):
            self.machine.warn(f"AFIO_MAPR.SWJ_CFG is written with {self.swj_cfg}, which is undefined")

    @property
    def debug_port(self) -> bool:
        """True while a probe can attach by SWD."""
        return self.swj_cfg in (0, 1, 2)

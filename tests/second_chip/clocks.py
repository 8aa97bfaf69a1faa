"""RCC, PWR and the backup registers (RM0008 7.3, 5.4, 6.4)."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from second_chip.block import Block, Layout

HSI_HZ = 8_000_000
HSE_HZ = 8_000_000
UNITS_HZ = 576_000_000
"""The model's unit of time: a whole number of units to a cycle at 8, 64 and 72 MHz."""
HSE_START_US, PLL_LOCK_US = 1000, 100
PIN_RESET, POWER_RESET, SOFTWARE_RESET, IWDG_RESET, WWDG_RESET = (1 << n for n in (26, 27, 28, 29, 30))
"""Flags of RCC_CSR."""


class Rcc(Block):
    LAYOUT: ClassVar[Layout] = {
        0x00: ("CR", 0x83, 0x010D00F9),
        0x04: ("CFGR", 0, 0x077FFFF3),
        0x08: ("CIR", 0, 0),
        0x0C: ("APB2RSTR", 0, 0x38FFFD),
        0x10: ("APB1RSTR", 0, 0x3AFEC9FF),
        0x14: ("AHBENR", 0x14, 0x557),
        0x18: ("APB2ENR", 0, 0x38FFFD),
        0x1C: ("APB1ENR", 0, 0x3AFEC9FF),
        0x20: ("BDCR", 0, 0x8305),
        0x24: ("CSR", POWER_RESET | PIN_RESET, 1),
    }

    def reset(self) -> None:
        kept = {name: value for name, value in self.value.items() if name in ("BDCR", "CSR")}
        super().reset()
        self.value.update(kept)
        self.value["CSR"] &= ~3  # the oscillator is off after any reset, the flags stay
        self.cycle = self._hclk()

    def write_CR(self, value: int) -> None:
        before = self.value["CR"]
        self.value["CR"] = before & ~0x010D00F9 | value & 0x010D00F9
        for on, ready, after_us in ((0, 1, 0), (16, 17, HSE_START_US), (24, 25, PLL_LOCK_US)):
            if value >> on & 1 == 0:
                in_use = self.bit("CFGR", 2, 2) == {0: 0, 16: 1, 24: 2}[on]
                if in_use:  # the clock that runs the chip cannot be stopped (RM0008 7.3.1)
                    self.value["CR"] |= 1 << on
                else:
                    self.value["CR"] &= ~(1 << ready)
            elif not before >> on & 1 and (on != 16 or self.chip.crystal):
                self.chip.after_us(after_us, partial(self._ready, on, ready))

    def _ready(self, on: int, ready: int) -> None:
        if self.bit("CR", on):
            self.value["CR"] |= 1 << ready

    def write_CFGR(self, value: int) -> None:
        locked = 0x3F0000 if self.bit("CR", 24) else 0  # source and factor, while the PLL is on
        value = value & ~locked | self.value["CFGR"] & locked
        ready = (1, 17, 25)
        wanted = value & 3
        source = wanted if wanted < 3 and self.bit("CR", ready[wanted]) else self.bit("CFGR", 2, 2)
        self.value["CFGR"] = value & 0x077FFFF3 | source << 2
        self.cycle = self._hclk()

    def write_CIR(self, value: int) -> None:
        if value >> 23 & 1:  # CSSC
            self.value["CIR"] &= ~(1 << 7)

    def write_APB2RSTR(self, value: int) -> None:
        self.value["APB2RSTR"] = value & 0x38FFFD
        if value >> 9 & 1:
            self.chip.adc.reset()

    def write_BDCR(self, value: int) -> None:
        if self.chip.pwr.bit("CR", 8):
            self.value["BDCR"] = value & 0x8305

    def write_CSR(self, value: int) -> None:
        self.value["CSR"] = self.value["CSR"] & ~1 | value & 1
        if value >> 24 & 1:
            self.value["CSR"] &= 1
        self._lsi()

    def start_lsi(self) -> None:
        """The independent watchdog forces the oscillator on, whatever LSION says (RM0008 7.2.5)."""
        self._lsi()

    def _lsi(self) -> None:
        """LSIRDY: the oscillator runs."""
        on = self.value["CSR"] & 1 or self.chip.iwdg.started
        self.value["CSR"] = self.value["CSR"] & ~2 | (2 if on else 0)

    # ---- lengths of a cycle, in units of time: `cycle` is the processor's ----

    def _hclk(self) -> int:
        if (source := self.bit("CFGR", 2, 2)) == 2:
            factor = min(self.bit("CFGR", 18, 4) + 2, 16)
            base_hz = HSE_HZ >> self.bit("CFGR", 17) if self.bit("CFGR", 16) else HSI_HZ // 2
            units = UNITS_HZ // (base_hz * factor)
        else:
            units = UNITS_HZ // (HSI_HZ, HSE_HZ)[source]
        prescaler = self.bit("CFGR", 4, 4)
        return units * (1 if prescaler < 8 else (2, 4, 8, 16, 64, 128, 256, 512)[prescaler - 8])

    def _divided(self, at: int) -> tuple[int, int]:
        prescaler = self.bit("CFGR", at, 3)
        divider = 1 if prescaler < 4 else 2 << prescaler - 4
        return self.cycle * divider, divider

    def pclk1(self) -> int:
        return self._divided(8)[0]

    def pclk2(self) -> int:
        return self._divided(11)[0]

    def timer1(self) -> int:
        """Timers on APB1 run at twice its clock where that is divided (RM0008 figure 8)."""
        units, divider = self._divided(8)
        return units // 2 if divider > 1 else units

    def timer2(self) -> int:
        units, divider = self._divided(11)
        return units // 2 if divider > 1 else units

    def adc(self) -> int:
        return self.pclk2() * 2 * (self.bit("CFGR", 14, 2) + 1)

    def crystal_fails(self) -> None:
        """The crystal stops: the security system, if it is on, takes HSI and raises NMI (RM0008 7.2.7)."""
        self.chip.crystal = False
        if not self.bit("CR", 19):
            return
        self.value["CR"] &= ~(3 << 16 | 1 << 19)
        from_crystal = self.bit("CFGR", 2, 2) == 1 or (self.bit("CFGR", 2, 2) == 2 and self.bit("CFGR", 16))
        if from_crystal:
            self.value["CR"] &= ~(3 << 24)
            self.value["CFGR"] &= ~0xF
            self.cycle = self._hclk()
        self.value["CIR"] |= 1 << 7
        self.chip.tim1.break_now()
        self.chip.nvic.nmi()


class Pwr(Block):
    LAYOUT: ClassVar[Layout] = {0x00: ("CR", 0, 0x1F3), 0x04: ("CSR", 0, 0x100)}
    CLOCK = ("APB1ENR", 28)


class Backup(Block):
    """Survives every reset; written only with PWR_CR.DBP set."""

    LAYOUT: ClassVar[Layout] = {4 * n: (f"DR{n}", 0, 0xFFFF) for n in range(1, 11)}
    CLOCK = ("APB1ENR", 27)

    def reset(self) -> None:
        if not self.value:
            super().reset()

    def write(self, offset: int, value: int) -> None:
        if self.chip.pwr.bit("CR", 8):
            super().write(offset, value)

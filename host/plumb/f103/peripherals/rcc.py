"""Reset and clock control (RM0008 chapter 7): oscillators with start-up times or faults, bus clocks, reset flags.

Start-up times are typical datasheet values: HSE 2 ms, PLL 200 us. A system clock that the part does not allow
(too few flash wait states, a bus above its limit) stops the simulation with the reason.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.nvic import NMI
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.peripherals.backup import DBP

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

HSION, HSIRDY, HSEON, HSERDY, CSSON, PLLON, PLLRDY = 1, 2, 1 << 16, 1 << 17, 1 << 19, 1 << 24, 1 << 25
LSEON = 1
CSSF, CSSC = 1 << 7, 1 << 23
SW_HSI, SW_HSE, SW_PLL = 0, 1, 2
RESET_FLAGS = {"power": 1 << 27, "pin": 0, "software": 1 << 28, "iwdg": 1 << 29, "wwdg": 1 << 30}
PINRSTF, RMVF, LSION, LSIRDY = 1 << 26, 1 << 24, 1, 2
HSE_START_US, PLL_START_US = 2000, 200
HSI_MHZ = 8
CRYSTALS_MHZ = (4, 6, 8, 10, 12, 14, 16)
"""Of those that HSE takes, those whose half has a period of a whole number of ticks."""
PLL_BITS = 0x003F0000
"""PLLSRC, PLLXTPRE, PLLMUL: frozen while the PLL runs."""
APB2_CLOCKS = {
    "AFIO": 0,
    "GPIOA": 2,
    "GPIOB": 3,
    "GPIOC": 4,
    "GPIOD": 5,
    "GPIOE": 6,
    "ADC1": 9,
    "ADC2": 10,
    "TIM1": 11,
    "SPI1": 12,
    "USART1": 14,
}
APB1_CLOCKS = {
    "TIM2": 0,
    "TIM3": 1,
    "TIM4": 2,
    "WWDG": 11,
    "USART2": 17,
    "USART3": 18,
    "I2C1": 21,
    "CAN": 25,
    "BKP": 27,
    "PWR": 28,
}
AHB_CLOCKS = {"DMA1": 0, "CRC": 6}


class Rcc(Peripheral):
    NARROW = "merge"
    REGISTERS = (
        Register("cr", 0x00, 0x00000083),
        Register("cfgr", 0x04),
        Register("cir", 0x08),
        Register("apb2rstr", 0x0C),
        Register("apb1rstr", 0x10),
        Register("ahbenr", 0x14, 0x00000014),
        Register("apb2enr", 0x18),
        Register("apb1enr", 0x1C),
        Register("bdcr", 0x20),
        Register("csr", 0x24),
    )
    cr: int
    cfgr: int
    cir: int
    ahbenr: int
    apb2enr: int
    apb1enr: int
    bdcr: int
    csr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "RCC", 0x40021000)
        self.crystal_dead = False
        self.pll_dead = False
        self.hse_mhz = 8
        self.hclk_ticks = self.pclk1_ticks = self.pclk2_ticks = self.timer1_ticks = 0
        """Ticks of a cycle of the core and AHB, of APB1, of APB2, and of the timers on APB1."""
        self.core_clock_lost = False

    def reset(self) -> None:
        flags, backup = self.csr & ~(LSION | LSIRDY), self.bdcr
        super().reset()
        self.csr, self.bdcr = flags, backup
        self.core_clock_lost = False
        self._gate()
        self._set_clock()

    def set_crystal(self, mhz: int) -> None:
        """Frequency of HSE, before the part starts. Raises UsageError."""
        if mhz not in CRYSTALS_MHZ:
            raise UsageError(f"a crystal of {mhz} MHz is not modelled; use one of {', '.join(map(str, CRYSTALS_MHZ))}")
        self.hse_mhz = mhz

    def write_bdcr(self, value: int) -> None:
        """Only LSEON of the backup domain is modelled: it keeps its value over resets, and on a battery over a loss of
        power, too."""
        if self.machine.pwr.cr & DBP:
            self.bdcr = value & LSEON
            self.machine.pins_changed()
        else:
            self.machine.warn("RCC_BDCR is written while PWR_CR.DBP protects it")

    def note_reset(self, cause: str) -> None:
        """Reset flags add up until RMVF; every reset also pulls the pin low."""
        self.csr |= RESET_FLAGS[cause] | PINRSTF

    # The frequencies, in MHz

    def _pll_mhz(self) -> int:
        source = HSI_MHZ // 2
        if self.cfgr & 1 << 16:
            source = self.hse_mhz // 2 if self.cfgr & 1 << 17 else self.hse_mhz
        multiplier = min(((self.cfgr >> 18) & 15) + 2, 16)
        if source * multiplier > 72:
            raise SimulationError(f"RCC_CFGR asks the PLL for {source * multiplier} MHz; 72 MHz is the limit")
        return source * multiplier

    def _sysclk_mhz(self) -> int:
        return {SW_HSI: HSI_MHZ, SW_HSE: self.hse_mhz, SW_PLL: self._pll_mhz()}[(self.cfgr >> 2) & 3]

    @property
    def adc_ticks(self) -> int:
        return self.pclk2_ticks * (2 + 2 * ((self.cfgr >> 14) & 3))

    def _apb_divider(self, shift: int) -> int:
        code = (self.cfgr >> shift) & 7
        return 1 if code < 4 else 2 << (code - 4)

    def _ahb_divider(self) -> int:
        code = (self.cfgr >> 4) & 15
        return 1 if code < 8 else (2, 4, 8, 16, 64, 128, 256, 512)[code - 8]

    def _set_clock(self) -> None:
        sysclk_mhz = self._sysclk_mhz()
        exact, rest = divmod(TICKS_PER_US, sysclk_mhz)
        if rest:
            raise SimulationError(f"a system clock of {sysclk_mhz} MHz is not modelled")
        ticks = exact * self._ahb_divider()
        allowed_mhz = (24, 48, 72)[min(self.machine.flash.acr & 7, 2)]
        if sysclk_mhz > allowed_mhz:
            raise SimulationError(
                f"system clock {sysclk_mhz} MHz with {self.machine.flash.acr & 7} flash wait states: "
                f"the limit is {allowed_mhz} MHz ({self.machine.where()})"
            )
        if ticks * self._apb_divider(8) * 36 < TICKS_PER_US:
            raise SimulationError(f"APB1 runs above 36 MHz: set RCC_CFGR.PPRE1 first ({self.machine.where()})")
        divider = self._apb_divider(8)
        self.timer1_ticks = ticks * (1 if divider == 1 else divider // 2)
        self.pclk1_ticks = ticks * divider
        self.pclk2_ticks = ticks * self._apb_divider(11)
        if ticks != self.hclk_ticks:
            self.hclk_ticks = ticks
            self.machine.cpu.set_clock(ticks, self.machine.flash.acr & 7)

    def _change_clock(self, cfgr: int) -> None:
        now = self.machine.now
        for peripheral in self.machine.bus.peripherals:
            peripheral.clock_changing(now)
        self.cfgr = cfgr
        self._set_clock()
        for peripheral in self.machine.bus.peripherals:
            peripheral.clock_changed(now)

    # Registers

    def write_cr(self, value: int) -> None:
        now, timeline = self.machine.now, self.machine.timeline
        running_from = (self.cfgr >> 2) & 3
        if running_from == SW_PLL:
            value |= PLLON  # cannot be stopped while it is the system clock
        if running_from == SW_HSE or (running_from == SW_PLL and self.cfgr & 1 << 16):
            value |= HSEON
        if running_from == SW_HSI:
            value |= HSION
        keep = self.cr & (HSERDY | PLLRDY)
        started = value & ~self.cr
        self.cr = value & (HSION | 0xF8 | HSEON | 1 << 18 | CSSON | PLLON) | keep
        self.cr |= HSIRDY if value & HSION else 0
        if started & HSEON and not self.crystal_dead:
            timeline.at("hse", now + HSE_START_US * TICKS_PER_US, lambda _t: self._ready(HSEON, HSERDY))
        if started & PLLON and not self.pll_dead:
            timeline.at("pll", now + PLL_START_US * TICKS_PER_US, lambda _t: self._ready(PLLON, PLLRDY))
        if not value & HSEON:
            self.cr &= ~HSERDY
            timeline.cancel("hse")
        if not value & PLLON:
            self.cr &= ~PLLRDY
            timeline.cancel("pll")

    def _ready(self, on: int, ready: int) -> None:
        from_crystal = self.cfgr & 1 << 16
        if on == PLLON and from_crystal and not self.cr & HSERDY:
            return  # a PLL without its input never locks
        if self.cr & on:
            self.cr |= ready
            self._switch()

    def write_cfgr(self, value: int) -> None:
        if self.cr & PLLON and (value ^ self.cfgr) & PLL_BITS:
            self.machine.warn("RCC_CFGR: PLL source or factor written while the PLL is on; the write is ignored")
            value = value & ~PLL_BITS | self.cfgr & PLL_BITS
        self._change_clock(value & 0x077FFFF3 | self.cfgr & 0x0C)
        self._switch()

    def _switch(self) -> None:
        """Copy SW to SWS when the selected oscillator is ready."""
        wanted = self.cfgr & 3
        if wanted == 3:
            raise SimulationError("RCC_CFGR.SW = 3 is not allowed")
        ready = (HSIRDY, HSERDY, PLLRDY)[wanted]
        if self.cr & ready and wanted != (self.cfgr >> 2) & 3:
            self._change_clock(self.cfgr & ~0x0C | wanted << 2)

    def write_cir(self, value: int) -> None:
        if value & 0x1F00:
            raise SimulationError("RCC_CIR: oscillator-ready interrupts are not modelled")
        if value & CSSC:
            self.cir &= ~CSSF
            self.machine.nvic.pending &= ~(1 << NMI)

    def read_csr(self) -> int:
        """LSIRDY is also set while the independent watchdog keeps LSI running (RM0008 7.2.5)."""
        return self.csr | (LSIRDY if self.machine.iwdg.running else 0)

    def write_csr(self, value: int) -> None:
        self.csr = self.csr & ~(LSION | LSIRDY) | (LSION | LSIRDY if value & LSION else 0)
        if value & RMVF:
            self.csr &= 0x00FFFFFF

    def _gate(self) -> None:
        """Switch the clock of every peripheral on or off by its enable bit."""
        for register, clocks in ((self.apb2enr, APB2_CLOCKS), (self.apb1enr, APB1_CLOCKS), (self.ahbenr, AHB_CLOCKS)):
            for name, bit in clocks.items():
                self.machine.by_name[name].switch_clock(bool(register >> bit & 1))

    def write_apb2enr(self, value: int) -> None:
        if self.apb2enr != value & 0x0038FFFD:
            self.apb2enr = value & 0x0038FFFD
            self._gate()

    def write_apb1enr(self, value: int) -> None:
        if self.apb1enr != value & 0x3AFEC9FF:
            self.apb1enr = value & 0x3AFEC9FF
            self._gate()

    def write_ahbenr(self, value: int) -> None:
        if self.ahbenr != value & 0x0557:
            self.ahbenr = value & 0x0557
            self._gate()

    def write_apb2rstr(self, value: int) -> None:
        self._reset_peripherals(value, APB2_CLOCKS)

    def write_apb1rstr(self, value: int) -> None:
        self._reset_peripherals(value, APB1_CLOCKS)

    def _reset_peripherals(self, value: int, clocks: dict[str, int]) -> None:
        for name, bit in clocks.items():
            if value >> bit & 1:
                self.machine.by_name[name].reset()

    # Faults

    def kill_crystal(self) -> None:
        """Stop the crystal for good. With the clock security system the part goes back to HSI and raises NMI; without
        it the core stops."""
        self.crystal_dead = True
        self.machine.timeline.cancel("hse")
        if not self.cr & HSERDY:
            return
        source = (self.cfgr >> 2) & 3
        in_use = source == SW_HSE or (source == SW_PLL and self.cfgr & 1 << 16)
        if self.cr & CSSON:
            self.cr &= ~(HSEON | HSERDY | CSSON | (PLLON | PLLRDY if self.cfgr & 1 << 16 else 0))
            if in_use:
                self._change_clock(self.cfgr & ~0x0F)
            self.cir |= CSSF
            self.machine.tim1.clock_failed()
            self.machine.nvic.pend(NMI)
            return
        self.cr &= ~HSERDY
        self.core_clock_lost = bool(in_use)

"""System control block and SysTick (Armv7-M B3.2, B3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register, SimulationError
from plumb.f103.core.nvic import ALWAYS_ENABLED, BUS_FAULT, MEMORY_FAULT, NMI, PENDSV, SVCALL, SYSTICK, USAGE_FAULT

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

CFSR_PRECISERR, CFSR_STKERR, CFSR_BFARVALID, CFSR_IBUSERR = 1 << 9, 1 << 12, 1 << 15, 1 << 8
CFSR_UNDEFINSTR, CFSR_INVSTATE, CFSR_INVPC, CFSR_NOCP, CFSR_UNALIGNED = 1 << 16, 1 << 17, 1 << 18, 1 << 19, 1 << 24
HFSR_DEBUGEVT, HFSR_FORCED, HFSR_VECTTBL = 1 << 31, 1 << 30, 1 << 1


class Scb(Peripheral):
    NARROW = "merge"
    REGISTERS = (
        Register("cpuid", 0x00, 0x411FC231, 0),
        Register("icsr", 0x04),
        Register("vtor", 0x08, 0, 0x3FFFFF80),
        Register("aircr", 0x0C, 0xFA050000),
        Register("scr", 0x10, 0, 0x16),
        Register("ccr", 0x14, 0, 0x31B),
        Register("shpr1", 0x18, 0, 0x00F0F0F0),
        Register("shpr2", 0x1C, 0, 0xF0000000),
        Register("shpr3", 0x20, 0, 0xF0F000F0),
        Register("shcsr", 0x24, 0, 0x00070000),
        Register("cfsr", 0x28),
        Register("hfsr", 0x2C),
        Register("dfsr", 0x30),
        Register("mmfar", 0x34),
        Register("bfar", 0x38),
    )
    vtor: int
    aircr: int
    scr: int
    ccr: int
    shcsr: int
    cfsr: int
    hfsr: int
    bfar: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "SCB", 0xE000ED00)

    def read_icsr(self) -> int:
        nvic = self.machine.nvic
        first = nvic.candidate()
        value = (nvic.active[-1] if nvic.active else 0) | first << 12
        value |= (len(nvic.active) <= 1) << 11
        value |= bool(nvic.pending >> 16) << 22
        for number, bit in ((NMI, 31), (PENDSV, 28), (SYSTICK, 26)):
            value |= ((nvic.pending >> number) & 1) << bit
        return value

    def write_icsr(self, value: int) -> None:
        nvic = self.machine.nvic
        if value & 1 << 27:
            nvic.pending &= ~(1 << PENDSV)
        if value & 1 << 25:
            nvic.pending &= ~(1 << SYSTICK)
        for number, bit in ((NMI, 31), (PENDSV, 28), (SYSTICK, 26)):
            if value & 1 << bit:
                nvic.pend(number)

    def write_aircr(self, value: int) -> None:
        if value >> 16 != 0x05FA:
            return  # without the key the write is ignored
        self.aircr = 0xFA050000 | value & 0x700
        self.machine.nvic.group_mask = 0xFF << (((value >> 8) & 7) + 1) & 0xFF
        if value & 1 << 2:
            self.machine.request_reset("software")

    def write_scr(self, value: int) -> None:
        if value & 1 << 2:
            raise SimulationError("SCB_SCR.SLEEPDEEP is set: stop and standby modes are not modelled")
        self.scr = value & 0x12

    def _write_priorities(self, first: int, value: int, numbers: tuple[int, ...]) -> None:
        for number in numbers:
            self.machine.nvic.priority[number] = (value >> (8 * (number - first))) & 0xF0
        self.machine.nvic.changed()

    def write_shpr1(self, value: int) -> None:
        self.shpr1 = value & 0x00F0F0F0
        self._write_priorities(4, value, (MEMORY_FAULT, BUS_FAULT, USAGE_FAULT))

    def write_shpr2(self, value: int) -> None:
        self.shpr2 = value & 0xF0000000
        self._write_priorities(8, value, (SVCALL,))

    def write_shpr3(self, value: int) -> None:
        self.shpr3 = value & 0xF0F000F0
        self._write_priorities(12, value, (PENDSV, SYSTICK))

    def write_shcsr(self, value: int) -> None:
        self.shcsr = value & 0x00070000
        nvic = self.machine.nvic
        nvic.enabled = nvic.enabled & ~(7 << MEMORY_FAULT) | ((value >> 16) & 7) << MEMORY_FAULT | ALWAYS_ENABLED

    def write_cfsr(self, value: int) -> None:
        self.cfsr &= ~value

    def write_hfsr(self, value: int) -> None:
        self.hfsr &= ~value


class SysTick(Peripheral):
    """Counts down LOAD..0 at HCLK or HCLK/8. VAL is computed when it is read; only TICKINT needs events."""

    REGISTERS = (
        Register("ctrl", 0x00),
        Register("load", 0x04, 0, 0x00FFFFFF),
        Register("val", 0x08),
        Register("calib", 0x0C, 9000, 0),
    )
    NARROW = "refuse"
    ctrl: int
    load: int
    val: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "SysTick", 0xE000E010)
        self.zero_at = 0
        self.flag = False

    def reset(self) -> None:
        super().reset()
        self.zero_at, self.flag = 0, False
        self.machine.timeline.cancel("systick")

    @property
    def step(self) -> int:
        return self.machine.rcc.hclk_ticks * (1 if self.ctrl & 4 else 8)

    def _settle(self, now: int) -> None:
        """Handle the counts of 0 up to now."""
        if self.ctrl & 1 and now >= self.zero_at:
            period = (self.load + 1) * self.step
            self.flag = True
            self.zero_at += ((now - self.zero_at) // period + 1) * period

    def _plan(self) -> None:
        if self.ctrl & 3 == 3 and self.load:
            self.machine.timeline.at("systick", self.zero_at, self._zero)
        else:
            self.machine.timeline.cancel("systick")

    def _zero(self, time: int) -> None:
        self._settle(time)
        self.machine.nvic.pend(SYSTICK)
        self._plan()

    def clock_changing(self, now: int) -> None:
        if self.ctrl & 1:
            self._settle(now)
            self.val = (self.zero_at - now) // self.step

    def clock_changed(self, now: int) -> None:
        if self.ctrl & 1:
            self.zero_at = now + self.val * self.step
            self._plan()

    def read_ctrl(self) -> int:
        self._settle(self.machine.now)
        value = self.ctrl | self.flag << 16
        self.flag = False
        return value

    def peek_ctrl(self) -> int:
        self._settle(self.machine.now)
        return self.ctrl | self.flag << 16

    def write_ctrl(self, value: int) -> None:
        now = self.machine.now
        self._settle(now)
        remaining = (self.zero_at - now) // self.step if self.ctrl & 1 else self.val
        self.ctrl = value & 7
        self.val = remaining
        if self.ctrl & 1:
            # From 0 the next cycle loads LOAD; LOAD 0 never counts.
            self.zero_at = now + (remaining or self.load + 1) * self.step
        self._plan()

    def write_load(self, value: int) -> None:
        self._settle(self.machine.now)
        self.load = value & 0xFFFFFF

    def read_val(self) -> int:
        if not self.ctrl & 1:
            return self.val
        now = self.machine.now
        self._settle(now)
        return ((self.zero_at - now) // self.step) % (self.load + 1)

    def write_val(self, value: int) -> None:
        self.val, self.flag = 0, False
        if self.ctrl & 1:
            self.zero_at = self.machine.now + (self.load + 1) * self.step
            self._plan()

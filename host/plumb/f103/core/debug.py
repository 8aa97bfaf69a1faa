"""Debug registers that firmware can read: the cycle counter, its enable bit, and the device id."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

DEMCR_TRCENA = 1 << 24


class CoreDebug(Peripheral):
    REGISTERS = (Register("dhcsr", 0x00, 0, 0), Register("demcr", 0x0C, 0, 0x010F07F1))
    demcr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "CoreDebug", 0xE000EDF0)

    def write_demcr(self, value: int) -> None:
        self.machine.dwt.settle()
        self.demcr = value & 0x010F07F1
        self.machine.dwt.restart()


class Dwt(Peripheral):
    """CYCCNT counts core cycles; it stops while the core sleeps in WFI, as on silicon without a debugger."""

    REGISTERS = (Register("ctrl", 0x00, 0x40000000, 1), Register("cyccnt", 0x04))
    ctrl: int
    cyccnt: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "DWT", 0xE0001000)
        self.awake_at = 0

    def counting(self) -> bool:
        return bool(self.ctrl & 1 and self.machine.core_debug.demcr & DEMCR_TRCENA)

    def settle(self) -> None:
        awake = self.machine.awake_ticks()
        if self.counting():
            self.cyccnt = (self.cyccnt + (awake - self.awake_at) // self.machine.rcc.hclk_ticks) & 0xFFFFFFFF
            # Keep the fraction of a cycle for the next update.
            awake -= (awake - self.awake_at) % self.machine.rcc.hclk_ticks
        self.awake_at = awake

    def restart(self) -> None:
        self.awake_at = self.machine.awake_ticks()

    def clock_changing(self, now: int) -> None:
        self.settle()

    def read_cyccnt(self) -> int:
        self.settle()
        return self.cyccnt

    def write_cyccnt(self, value: int) -> None:
        self.cyccnt = value
        self.restart()

    def write_ctrl(self, value: int) -> None:
        self.settle()
        self.ctrl = 0x40000000 | value & 1
        self.restart()


class DbgMcu(Peripheral):
    """User code reads 0 as the device id, only a debugger reads the id (errata sheets of the F103)."""

    REGISTERS = (Register("idcode", 0x00, 0, 0), Register("cr", 0x04, 0, 0))
    NARROW = "refuse"

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "DBGMCU", 0xE0042000)

    def read_idcode(self) -> int:
        return self.machine.part.idcode if self.machine.debugger_attached else 0

    def peek_idcode(self) -> int:
        return self.machine.part.idcode

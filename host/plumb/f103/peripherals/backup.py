"""Power control and backup registers (RM0008 chapters 5 and 6), which keep their values over resets but not over a loss
of power.

VBAT is connected to the supply, as on boards without a battery.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from plumb.f103.core.bus import Peripheral, Register

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu

DBP = 1 << 8


class Pwr(Peripheral):
    REGISTERS = (Register("cr", 0x00, 0, 0x1F3), Register("csr", 0x04, 0, 0x100))  # CWUF, CSBF of CR always read 0
    cr: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "PWR", 0x40007000)


class Bkp(Peripheral):
    """Ten registers of 16 bits; DBP opens them for writing."""

    REGISTERS = tuple(Register(f"dr{i}", 4 * i) for i in range(1, 11))
    dr1: int

    def __init__(self, machine: Mcu) -> None:
        super().__init__(machine, "BKP", 0x40006C00)

    def reset(self) -> None:
        """Does nothing: the registers keep their values."""

    def power_lost(self) -> None:
        super().reset()

    def plain_writer(self, register: Register) -> Callable[[int], None]:
        def write(value: int) -> None:
            if self.machine.pwr.cr & DBP:
                setattr(self, register.name, value & 0xFFFF)
            else:
                self.machine.warn(f"BKP_{register.name.upper()} is written while PWR_CR.DBP protects it")

        return write

"""Flash controller (PM0075): wait states and lock. Erasing and programming are not modelled yet and say so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.bus import Peripheral, Register, SimulationError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

KEYS = (0x45670123, 0xCDEF89AB)
LOCK = 1 << 7
ACTIONS = 0x76
"""PG, PER, MER, OPTPG, OPTER, STRT."""


class Flash(Peripheral):
    NARROW = "refuse"
    REGISTERS = (
        Register("acr", 0x00, 0x30),
        Register("keyr", 0x04),
        Register("optkeyr", 0x08),
        Register("sr", 0x0C),
        Register("cr", 0x10, LOCK),
        Register("ar", 0x14),
        Register("obr", 0x1C, 0x03FFFFFC, 0),
        Register("wrpr", 0x20, 0xFFFFFFFF, 0),
    )
    acr: int
    cr: int

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine, "FLASH", 0x40022000)
        self.keys_seen = 0

    def reset(self) -> None:
        super().reset()
        self.keys_seen = 0

    def write_acr(self, value: int) -> None:
        if value & 7 > 2:
            raise SimulationError(f"FLASH_ACR.LATENCY = {value & 7} is reserved")
        self.acr = value & 0x1F | (value & 0x10) << 1  # PRFTBS follows PRFTBE

    def read_keyr(self) -> int:
        return 0

    def write_keyr(self, value: int) -> None:
        if self.keys_seen < 2 and value == KEYS[self.keys_seen]:
            self.keys_seen += 1
            if self.keys_seen == 2:
                self.cr &= ~LOCK
        else:
            self.keys_seen = 3  # a wrong key locks until reset
            self.cr |= LOCK

    def write_cr(self, value: int) -> None:
        if self.cr & LOCK:
            self.machine.warn("FLASH_CR is written while locked")
            return
        if value & ACTIONS:
            raise SimulationError(f"FLASH_CR = 0x{value:X}: erasing and programming are not modelled")
        if value & LOCK:
            self.cr |= LOCK
            self.keys_seen = 0

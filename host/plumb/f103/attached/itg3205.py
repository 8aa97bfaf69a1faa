"""Register model of the ITG-3205 gyro (InvenSense data sheet PS-ITG-3205A), on I2C.

The source gives rates in deg/s. The chip's low-pass is not modelled: the source has the noise and lag of the filter
that is set. Not modelled: the interrupt pin, standby of single axes, temperature other than 35 deg C.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from plumb.f103.attached.chip import Chip, Source
from plumb.f103.core.bus import SimulationError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

IDENTITY, ADDRESS = 0x69, 0x68
"""Bits 6 to 1 of WHO_AM_I are 110100; bit 0 is undefined, and read as 1 on chips in the field."""
SMPLRT_DIV, DLPF_FS, INT_CFG, INT_STATUS, TEMP, GYRO, PWR_MGM = 0x15, 0x16, 0x17, 0x1A, 0x1B, 0x1D, 0x3E
RAW_DATA_RDY, RAW_RDY_EN, SLEEP, FULL_SCALE, WIDE = 0x01, 0x01, 0x40, 0x18, (0, 7)
COUNTS_PER_DPS = 14.375
TEMPERATURE = (-13200 & 0xFFFF).to_bytes(2, "big")


class Itg3205(Chip):
    NAME, SIZE, DATA = "itg3205", 0x3F, GYRO
    POWER_ON: ClassVar[dict[int, int]] = {TEMP: TEMPERATURE[0], TEMP + 1: TEMPERATURE[1]}

    def __init__(self, machine: Machine, source: Source, address: int = ADDRESS) -> None:
        super().__init__(machine, source, address, IDENTITY)

    def period_s(self) -> float:
        if self.registers[PWR_MGM] & SLEEP:
            return 0.0
        internal_hz = 8000.0 if self.registers[DLPF_FS] & 7 in WIDE else 1000.0
        return (self.registers[SMPLRT_DIV] + 1) / internal_hz

    def convert(self, felt: tuple[float, float, float]) -> tuple[int, int, int]:
        if self.registers[DLPF_FS] & FULL_SCALE != FULL_SCALE:
            return 0, 0, 0  # FS_SEL 0 to 2 are reserved: without the setting there is no rate
        x, y, z = (min(max(round(dps * COUNTS_PER_DPS), -32768), 32767) for dps in felt)
        return x, y, z

    def store(self) -> None:
        self.registers[GYRO : GYRO + 6] = b"".join(count.to_bytes(2, "big", signed=True) for count in self.counts)
        if self.registers[INT_CFG] & RAW_RDY_EN:
            self.registers[INT_STATUS] |= RAW_DATA_RDY

    def written(self, register: int, value: int) -> None:
        if register not in (SMPLRT_DIV, DLPF_FS, INT_CFG, PWR_MGM):
            self.machine.warn(f"ITG-3205: register 0x{register:02X} is written, which is read-only or reserved")
            return
        if register == PWR_MGM and value & 0x80:
            self.brown_out()
            return
        if register == PWR_MGM and value & 0x38:
            raise SimulationError(f"ITG-3205: PWR_MGM = 0x{value:02X}: standby of single axes is not modelled")
        self.registers[register] = value
        self.settings_changed()

    def noticed(self, register: int) -> None:
        if register == INT_STATUS:
            self.registers[INT_STATUS] = 0

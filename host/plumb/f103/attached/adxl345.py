"""Register model of the ADXL345 accelerometer (Analog Devices data sheet, rev. E), on I2C or SPI.

The source gives accelerations in g. The chip's low-pass is not modelled: the source has the noise and lag of the output
rate that is set. Not modelled: FIFO modes, interrupt pins, tap, activity and free-fall, left-justified and self-test
data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from plumb.f103.attached.chip import Source, SpiChip
from plumb.f103.core.bus import SimulationError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

IDENTITY, ADDRESS = 0xE5, 0x53
BW_RATE, POWER_CTL, INT_SOURCE, DATA_FORMAT, DATAX0, FIFO_CTL = 0x2C, 0x2D, 0x30, 0x31, 0x32, 0x38
MEASURE, DATA_READY, FULL_RES, THREE_WIRES = 0x08, 0x80, 0x08, 0x40
READ_ONLY = (0x00, 0x2B, 0x30, *range(0x32, 0x38), 0x39)
COUNTS_PER_G = 256
FASTEST_HZ = 3200.0


class Adxl345(SpiChip):
    NAME, SIZE, DATA = "adxl345", 0x3A, DATAX0
    SPI_MHZ, SPI_MANY = 5.0, 0x40
    POWER_ON: ClassVar[dict[int, int]] = {BW_RATE: 0x0A, INT_SOURCE: 0x02}

    def __init__(self, machine: Machine, source: Source, address: int = ADDRESS) -> None:
        super().__init__(machine, source, address, IDENTITY)

    def period_s(self) -> float:
        if not self.registers[POWER_CTL] & MEASURE:
            return 0.0
        return 2.0 ** (15 - (self.registers[BW_RATE] & 15)) / FASTEST_HZ

    def convert(self, felt: tuple[float, float, float]) -> tuple[int, int, int]:
        form = self.registers[DATA_FORMAT]
        scale = COUNTS_PER_G if form & FULL_RES else COUNTS_PER_G >> (form & 3)
        limit = 512 << (form & 3) if form & FULL_RES else 512
        fine = (self.registers[BW_RATE] & 15) < 14  # above 800 Hz the last bit is 0
        x, y, z = (min(max(round(g * scale), -limit), limit - 1) & (-1 if fine else -2) for g in felt)
        return x, y, z

    def store(self) -> None:
        data = b"".join(count.to_bytes(2, "little", signed=True) for count in self.counts)
        self.registers[DATAX0 : DATAX0 + 6] = data
        self.registers[INT_SOURCE] |= DATA_READY

    def written(self, register: int, value: int) -> None:
        if register in READ_ONLY or 0x01 <= register <= 0x1C:
            self.machine.warn(f"ADXL345: register 0x{register:02X} is written, which is read-only or reserved")
            return
        if (register == DATA_FORMAT and value & 0xC4) or (register == FIFO_CTL and value & 0xC0):
            raise SimulationError(f"ADXL345: 0x{value:02X} in register 0x{register:02X} is a mode that is not modelled")
        self.registers[register] = value
        if register in (BW_RATE, POWER_CTL):
            self.settings_changed()

    def noticed(self, register: int) -> None:
        if self.DATA <= register < self.DATA + 6:
            self.registers[INT_SOURCE] &= ~DATA_READY

"""Register model of InvenSense's chips with gyro and accelerometer: MPU-6050 (register map RM-MPU-6000A-00, rev. 4.2)
and what is sold under its name on I2C, its successors on SPI.

Two sources: rates in deg/s, specific forces in g. The chip's low-pass is not modelled: the sources have the noise and
lag of the filter that is set. A burst is one sample (chapter 4.17): the registers do not change during one access. Not
modelled: the interrupt pin, FIFO, secondary I2C bus, self-test, cycling, standby of single axes, temperature other than
that of 0 counts; the accelerometer's own filter register of MPU-6500 and ICM-20689 (0x1D).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from plumb.f103.attached.chip import Source, SpiChip
from plumb.f103.core.bus import SimulationError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG, ACCEL_CONFIG_2 = 0x19, 0x1A, 0x1B, 0x1C, 0x1D
INT_ENABLE, INT_STATUS, ACCEL, TEMP, GYRO, PWR_MGMT_1, PWR_MGMT_2, WHO_AM_I = (
    0x38, 0x3A, 0x3B, 0x41, 0x43, 0x6B, 0x6C, 0x75,
)  # fmt: skip
DATA_RDY, SLEEP, RESET, WIDE = 0x01, 0x40, 0x80, (0, 7)
BYTES = 14
LSB_PER_DPS, LSB_PER_G = (131.0, 65.5, 32.8, 16.4), (16384, 8192, 4096, 2048)
"""For each value of FS_SEL and of AFS_SEL."""


@dataclass(frozen=True)
class Part:
    """A chip of the family. address: on I2C, 0 without it; power_on: registers that do not start at 0; spi_alone:
    register and bits that switch I2C off, bits 0 without them; accel_filter: the accelerometer has a filter of its
    own."""

    name: str
    title: str
    identity: int
    address: int
    spi_mhz: float
    power_on: Mapping[int, int]
    spi_alone: tuple[int, int]
    accel_filter: bool


class Invensense(SpiChip):
    SIZE, DATA = 0x76, ACCEL
    POWER_ON: ClassVar[dict[int, int]] = {}

    def __init__(self, machine: Machine, rates: Source, forces: Source, part: Part) -> None:
        self.part = part
        self.NAME = part.name  # type: ignore[misc]  # one class for every chip of the family
        self.POWER_ON = dict(part.power_on)  # type: ignore[misc]
        self.SPI_MHZ = part.spi_mhz
        self.spi_alone = part.spi_alone
        self.settings = {SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG, INT_ENABLE, PWR_MGMT_1, PWR_MGMT_2}
        self.settings |= {ACCEL_CONFIG_2} if part.accel_filter else set()
        self.settings |= {self.spi_alone[0]} if self.spi_alone[1] else set()
        self.forces = forces
        self.force_counts = (0, 0, 0)
        self.forces_frozen = False
        """True: the accelerometer takes no new samples; the gyro does."""
        super().__init__(machine, rates, part.address, part.identity)

    def period_s(self) -> float:
        if self.registers[PWR_MGMT_1] & SLEEP:
            return 0.0
        internal_hz = 8000.0 if self.registers[CONFIG] & 7 in WIDE else 1000.0
        return (self.registers[SMPLRT_DIV] + 1) / internal_hz

    def convert(self, felt: tuple[float, float, float]) -> tuple[int, int, int]:
        gyro, accel = (self.registers[at] >> 3 & 3 for at in (GYRO_CONFIG, ACCEL_CONFIG))
        if not self.forces_frozen:
            self.force_counts = _counts(self.forces(self.sampled_s), LSB_PER_G[accel])
        return _counts(felt, LSB_PER_DPS[gyro])

    def store(self) -> None:
        self.registers[ACCEL:TEMP] = _bytes(self.force_counts)
        self.registers[TEMP:GYRO] = bytes(2)
        self.registers[GYRO : GYRO + 6] = _bytes(self.counts)
        self.registers[INT_STATUS] |= DATA_RDY & self.registers[INT_ENABLE]

    def written(self, register: int, value: int) -> None:
        if register not in self.settings:
            self.machine.warn(
                f"{self.part.title}: register 0x{register:02X} is written, which is read-only or not modelled"
            )
            return
        if register == PWR_MGMT_1 and value & RESET:
            self.brown_out()
            return
        modes = {GYRO_CONFIG: 0xE3, ACCEL_CONFIG: 0xE0, PWR_MGMT_1: 0x20, PWR_MGMT_2: 0xFF, CONFIG: 0xB8}
        modes |= {ACCEL_CONFIG_2: 0xF8, self.spi_alone[0]: ~self.spi_alone[1] & 0xFF}
        if value & modes.get(register, 0):
            raise SimulationError(
                f"{self.part.title}: 0x{value:02X} in register 0x{register:02X} is a mode that is not modelled"
            )
        self.registers[register] = value
        if register in (SMPLRT_DIV, CONFIG, PWR_MGMT_1):
            self.settings_changed()

    def noticed(self, register: int) -> None:
        if register == INT_STATUS:
            self.registers[INT_STATUS] = 0

    def _read(self) -> int:
        assert self._pointer is not None
        register = self._pointer % self.SIZE
        self._pointer = register + 1
        if register == ACCEL:
            self.on_read(self.sampled_s, self.counts)
            self._latched = bytes(self.registers[ACCEL : ACCEL + BYTES])
        if ACCEL <= register < ACCEL + BYTES and self._latched:
            return self._latched[register - ACCEL]
        value = self.identity if register == WHO_AM_I else self.registers[register]
        self.noticed(register)
        return value


def _counts(felt: tuple[float, float, float], per_unit: float) -> tuple[int, int, int]:
    x, y, z = (min(max(round(value * per_unit), -32768), 32767) for value in felt)
    return x, y, z


def _bytes(counts: tuple[int, int, int]) -> bytes:
    return b"".join(count.to_bytes(2, "big", signed=True) for count in counts)

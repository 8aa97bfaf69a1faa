"""Register model of the MPU-6050, gyro and accelerometer in one chip (InvenSense register map RM-MPU-6000A-00, rev.
4.2), on I2C; identity= makes it one of the chips that are sold under its name.

Two sources: rates in deg/s, specific forces in g. The chip's low-pass is not modelled: the sources have the noise and
lag of the filter that is set. A burst is one sample (chapter 4.17): the registers do not change during one access. Not
modelled: the interrupt pin, FIFO, secondary I2C bus, self-test, cycling, standby of single axes, temperature other than
36.53 deg C; the accelerometer's own filter register of MPU-6500 and ICM-20689 (0x1D).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from plumb.f103.attached.chip import Chip, Source
from plumb.f103.core.bus import SimulationError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

IDENTITIES = {0x68: "MPU-6050", 0x70: "MPU-6500", 0x72: "an MPU-6500 of unknown make", 0x98: "ICM-20689"}
"""WHO_AM_I of the chips on modules sold as MPU-6050."""
ADDRESS = 0x68
SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG = 0x19, 0x1A, 0x1B, 0x1C
INT_ENABLE, INT_STATUS, ACCEL, TEMP, GYRO, PWR_MGMT_1, PWR_MGMT_2, WHO_AM_I = (
    0x38, 0x3A, 0x3B, 0x41, 0x43, 0x6B, 0x6C, 0x75,
)  # fmt: skip
DATA_RDY, SLEEP, RESET, WIDE = 0x01, 0x40, 0x80, (0, 7)
BYTES = 14
LSB_PER_DPS, LSB_PER_G = (131.0, 65.5, 32.8, 16.4), (16384, 8192, 4096, 2048)
"""For each value of FS_SEL and of AFS_SEL."""


class Mpu6050(Chip):
    NAME, SIZE, DATA = "mpu6050", 0x76, ACCEL
    POWER_ON: ClassVar[dict[int, int]] = {PWR_MGMT_1: SLEEP}

    def __init__(
        self, machine: Machine, rates: Source, forces: Source, address: int = ADDRESS, identity: int = 0x68
    ) -> None:
        self.forces = forces
        self.force_counts = (0, 0, 0)
        self.forces_frozen = False
        """True: the accelerometer takes no new samples; the gyro does."""
        super().__init__(machine, rates, address, identity)

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
        self.registers[TEMP:GYRO] = bytes(2)  # 0 is 36.53 deg C
        self.registers[GYRO : GYRO + 6] = _bytes(self.counts)
        self.registers[INT_STATUS] |= DATA_RDY & self.registers[INT_ENABLE]

    def written(self, register: int, value: int) -> None:
        if register not in (SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG, INT_ENABLE, PWR_MGMT_1, PWR_MGMT_2):
            self.machine.warn(f"MPU-6050: register 0x{register:02X} is written, which is read-only or not modelled")
            return
        if register == PWR_MGMT_1 and value & RESET:
            self.brown_out()
            return
        modes = {GYRO_CONFIG: 0xE0, ACCEL_CONFIG: 0xE0, PWR_MGMT_1: 0x20, PWR_MGMT_2: 0xFF, CONFIG: 0x38}
        if value & modes.get(register, 0):
            raise SimulationError(
                f"MPU-6050: 0x{value:02X} in register 0x{register:02X} is a mode that is not modelled"
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

"""A gyro and an accelerometer with the errors of a part, many runs at once: true means in, raw counts out.

    mpu6050           data sheet Rev. 3.4: 16 bits at +-2000 deg/s and +-16 g, accelerometer 400 ug/sqrt(Hz), gyro 0.005
    adxl345_itg3205   data sheets Rev. G and Rev. 1.0: 256 counts/g, 14.375 counts per deg/s; 290 ug and 0.03 deg/s

Assumed for both, after a calibration by the user: bias of the gyro 1 deg/s an axis, its sign drawn, and N(0.5 deg/s)
more as it warms up with a time constant of 30 s; scale N(1 %), misalignment N(0.7 %), offset of the accelerometer N(2
mg) an axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.physics.vectors import to_earth
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel

DRAWS = 18
"""Unit normal numbers for the errors of one run."""
WARM_UP_S = 30.0
"""Time constant with which the gyro warms up."""


@dataclass(frozen=True)
class ImuGrade:
    """Noise densities one-sided; errors of the axes as the head of this file says."""

    gyro: Channel
    accel: Channel
    gyro_noise_dps: float
    accel_noise_g: float
    bias_dps: float = 1.0
    warm_up_dps: float = 0.5
    scale: float = 0.01
    misalignment: float = 0.007
    offset_g: float = 0.002


# The last count of each side is a sensor at its rail: beyond the limits, and so flagged.
MPU6050 = ImuGrade(Channel(0.0, 1.0 / 16.4, -32767, 32766), Channel(0.0, 1.0 / 2048.0, -32767, 32766), 0.005, 400e-6)
TWO_CHIPS = ImuGrade(Channel(0.0, 1.0 / 14.375, -28750, 28750), Channel(0.0, 1.0 / 256.0, -4095, 4094), 0.03, 290e-6)
IMU_GRADES = {"mpu6050": MPU6050, "adxl345_itg3205": TWO_CHIPS}


class Imu:
    """The sensors of all runs, read every period_s. matrix: scale and misalignment of the gyro, (3, 3, runs);
    stepped_dps: what a shock has added to its bias, (3, runs); gyro_noise_dps, accel_noise_g: of a sample."""

    def __init__(self, grade: ImuGrade, drawn: FloatArray, period_s: float) -> None:
        """drawn: unit normal numbers for the errors, (DRAWS, runs)."""
        self.grade = grade
        runs = drawn.shape[1]
        matrix = grade.misalignment * drawn[:9].reshape(3, 3, runs)
        for axis in range(3):
            matrix[axis, axis] = 1.0 + grade.scale * drawn[4 * axis]
        self.matrix = matrix
        self.stepped_dps = np.zeros((3, 1))
        self.bias_dps = grade.bias_dps * np.where(drawn[9:12] < 0.0, -1.0, 1.0)
        self.warm_up_dps = grade.warm_up_dps * drawn[15:18]
        self.offset_g = grade.offset_g * drawn[12:15]
        per_sample = np.sqrt(0.5 / period_s)
        self.gyro_noise_dps = float(grade.gyro_noise_dps * per_sample)
        self.accel_noise_g = float(grade.accel_noise_g * per_sample)

    def numbers(self) -> dict[str, float]:
        """For a plant in C: units and limits of the counts, noise of a sample, and the time of warming up."""
        numbers = {}
        for name, channel in (("gyro", self.grade.gyro), ("accel", self.grade.accel)):
            numbers[f"{name}_unit"] = channel.unit_per_count
            numbers[f"{name}_least"], numbers[f"{name}_most"] = float(channel.min_counts), float(channel.max_counts)
        noise = {"gyro_noise_dps": self.gyro_noise_dps, "accel_noise_g": self.accel_noise_g}
        return {**numbers, **noise, "warm_up_s": WARM_UP_S}

    def bias_now_dps(self, time_s: float) -> FloatArray:
        """Bias of the gyro, (3, runs); time_s: since power-up."""
        return np.asarray(self.bias_dps + self.stepped_dps - self.warm_up_dps * math.expm1(-time_s / WARM_UP_S))

    def counts(
        self, time_s: float, rate_dps: FloatArray, force_g: FloatArray, white: FloatArray
    ) -> npt.NDArray[np.int16]:
        """Counts (runs, 6) for the mean rate and specific force since the sample before, (3, runs) each. time_s: since
        power-up; white: unit noise, (6, runs)."""
        rate = to_earth(self.matrix, rate_dps) + self.bias_now_dps(time_s) + self.gyro_noise_dps * white[:3]
        force = force_g + self.offset_g + self.accel_noise_g * white[3:]
        found = np.empty((rate.shape[1], 6), np.int16)
        for part, values, channel in ((0, rate, self.grade.gyro), (3, force, self.grade.accel)):
            limited = np.clip(np.rint(values / channel.unit_per_count), channel.min_counts, channel.max_counts)
            found[:, part : part + 3] = limited.T
        return found

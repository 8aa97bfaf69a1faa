"""Errors of sensors of other grades, added to a recording: what an algorithm must bear on a cheaper part.

Every grade draws from a seed and from the name of the recording: two seeds of six recordings are twelve sensors. A
density is one-sided, as data sheets give it: white noise of density d has the standard deviation d sqrt(rate / 2). The
errors are added before the counts are limited to the range of the sensor.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.samples import SIXTEEN_BITS, Motion, Sensor
from plumb.spec.tuning import Channel

FloatArray = npt.NDArray[np.float64]
Degrade = Callable[[Motion, np.random.Generator], Motion]

SEEDS = (1, 2)


@dataclass(frozen=True)
class Grade:
    """title: one line. degrade: adds the errors to a motion. sensor: its counts. seeds: () where nothing is drawn."""

    title: str
    degrade: Degrade | None = None
    sensor: Sensor = SIXTEEN_BITS

    @property
    def seeds(self) -> tuple[int, ...]:
        return SEEDS if self.degrade else (0,)

    def of(self, motion: Motion, seed: int) -> Motion:
        """The motion as a sensor of this grade feels it, the same one for the same recording and seed."""
        if self.degrade is None:
            return motion
        return self.degrade(motion, np.random.default_rng([seed, zlib.crc32(motion.name.encode())]))


def _gyro(motion: Motion, added_dps: FloatArray) -> Motion:
    return replace(motion, gyr_dps=motion.gyr_dps + added_dps)


def _signs(rng: np.random.Generator) -> FloatArray:
    return np.asarray(rng.choice([-1.0, 1.0], 3), np.float64)


def _white(rng: np.random.Generator, motion: Motion, density: float) -> FloatArray:
    sigma = density * np.sqrt(0.5 / motion.period_s)
    return np.asarray(sigma * rng.standard_normal(motion.gyr_dps.shape), np.float64)


def _matrix(motion: Motion, rng: np.random.Generator) -> Motion:
    return _gyro(motion, motion.gyr_dps @ (0.01 * rng.standard_normal((3, 3))).T)


def _bias(motion: Motion, rng: np.random.Generator) -> Motion:
    return _gyro(motion, 4.0 * _signs(rng))


def _warm_up(motion: Motion, rng: np.random.Generator) -> Motion:
    return _gyro(motion, _signs(rng) * (1.0 - np.exp(-motion.time_s[:, None] / 30.0)))


def _noise(motion: Motion, rng: np.random.Generator) -> Motion:
    return _gyro(motion, _white(rng, motion, 0.1))


def _g_sensitivity(motion: Motion, rng: np.random.Generator) -> Motion:
    return _gyro(motion, motion.acc_g @ (0.1 * rng.standard_normal((3, 3))).T)


def _mpu6050(motion: Motion, rng: np.random.Generator) -> Motion:
    errors = 0.007 * rng.standard_normal((3, 3))
    np.fill_diagonal(errors, 0.01 * rng.standard_normal(3))
    worse = _gyro(motion, motion.gyr_dps @ errors.T + _signs(rng))
    return replace(worse, acc_g=worse.acc_g + _white(rng, motion, 400e-6))


TWO_CHIPS = Sensor(
    Channel(zero_counts=0.0, unit_per_count=1.0 / 14.375, min_counts=-28750, max_counts=28750),
    Channel(zero_counts=0.0, unit_per_count=1.0 / 256.0, min_counts=-4096, max_counts=4095),
)
"""ITG-3205 at +-2000 deg/s (14.375 LSB per deg/s) and ADXL345 in full resolution at +-16 g (256 LSB/g): their data
sheets, Rev. 1.0 and Rev. G."""

AS_RECORDED = "recorded"
GRADES: dict[str, Grade] = {
    AS_RECORDED: Grade("as recorded, 16 bits at +-2000 deg/s and +-16 g"),
    "adxl345-itg3205": Grade("as recorded, in the resolution of ADXL345 and ITG-3205", None, TWO_CHIPS),
    "matrix": Grade("gyro matrix (scale and misalignment) off by 1 % rms an entry", _matrix),
    "bias": Grade("gyro bias of 4 deg/s an axis, its sign drawn", _bias),
    "warm-up": Grade("gyro bias that grows to 1 deg/s an axis with a time constant of 30 s, its sign drawn", _warm_up),
    "noise": Grade("gyro noise of 0.1 deg/s/sqrt(Hz)", _noise),
    "g-sensitivity": Grade("gyro that feels acceleration, 0.1 deg/s/g rms an entry", _g_sensitivity),
    "mpu6050": Grade("MPU-6050: scale 1 %, misalignment 0.7 %, bias 1 deg/s, accelerometer 400 ug/sqrt(Hz)", _mpu6050),
}
"""Name -> grade, in the order of the table."""

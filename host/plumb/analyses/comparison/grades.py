"""Errors of sensors of other grades, added to a recording: what an algorithm must bear on a cheaper part.

Every grade draws from a seed and from the name of the recording: two seeds of six recordings are twelve sensors. A
density is one-sided, as data sheets give it: white noise of density d has the standard deviation d sqrt(rate / 2). The
errors are added before the counts are limited to the range of the sensor; samples are lost after that.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison import losses
from plumb.analyses.comparison.samples import (
    SIXTEEN_BITS,
    Motion,
    Samples,
    Sensor,
    clipping,
    dropped,
    held,
    sampled,
    started_inside,
)
from plumb.spec.tuning import Channel

FloatArray = npt.NDArray[np.float64]
Degrade = Callable[[Motion, np.random.Generator], Motion]

ERROR_DRAWS, LOSS_DRAWS = 2, 3


@dataclass(frozen=True)
class Grade:
    """Errors that a sensor adds to a motion.

    title: one line. degrade: adds the errors to a motion. sensor: its counts. loss: the samples that are lost;
    declared: known to be, else they leave no trace. window_s: runs begin inside the motion and are
    scored between these times. draws: seeds, 0 where nothing is drawn. bias_dps: the bias of the gyro's axes that it
    adds.
    """

    title: str
    degrade: Degrade | None = None
    sensor: Sensor = SIXTEEN_BITS
    loss: losses.Loss | None = None
    declared: bool = True
    window_s: tuple[float, float] | None = None
    draws: int = 0
    bias_dps: float = 0.0

    @property
    def seeds(self) -> tuple[int, ...]:
        return tuple(range(1, self.draws + 1)) or (0,)

    def of(self, motion: Motion, seed: int) -> Motion:
        """The motion as a sensor of this grade feels it, the same one for the same recording and seed."""
        return motion if self.degrade is None else self.degrade(motion, _generator(motion, seed))

    def samples(self, motion: Motion, seed: int, block: int) -> tuple[Samples, ...]:
        """The runs that an algorithm makes of a motion, at a rate that is `block` times lower."""
        found = sampled(self.of(motion, seed), self.sensor, block)
        if self.loss is not None:
            lost = self.loss(len(found.counts), found.period_us * 1e-6, _generator(motion, seed))
            found = held(found, lost) if self.declared else dropped(found, lost)
        return (found,) if self.window_s is None else started_inside(found, self.window_s)


def _generator(motion: Motion, seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(motion.name.encode())])


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


OFFSET_G, ACCEL_SCALE, ACCEL_SQUARE = 0.03, 0.02, 0.005


def _accel_errors(motion: Motion, rng: np.random.Generator) -> Motion:
    errors = ACCEL_SQUARE * rng.standard_normal((3, 3))
    np.fill_diagonal(errors, ACCEL_SCALE * rng.standard_normal(3))
    offset = rng.standard_normal(3)
    offset_g = OFFSET_G * offset / np.linalg.norm(offset)
    return replace(motion, acc_g=motion.acc_g @ (np.eye(3) + errors).T + offset_g)


def _mpu6050_whole(motion: Motion, rng: np.random.Generator) -> Motion:
    return _accel_errors(_mpu6050(motion, rng), rng)


LOW = 0.97


def _gravity_low(motion: Motion, _rng: np.random.Generator) -> Motion:
    return replace(motion, acc_g=LOW * motion.acc_g)


SOON_S, LATER_S = (2.0, 10.0), (10.0, 40.0)
"""After a start inside a motion: what is scored as the start, and what after it."""

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
    "matrix": Grade("gyro matrix (scale and misalignment) off by 1 % rms an entry", _matrix, draws=ERROR_DRAWS),
    "bias": Grade("gyro bias of 4 deg/s an axis, its sign drawn", _bias, draws=ERROR_DRAWS, bias_dps=4.0),
    "warm-up": Grade(
        "gyro bias that grows to 1 deg/s an axis with a time constant of 30 s, its sign drawn",
        _warm_up,
        draws=ERROR_DRAWS,
        bias_dps=1.0,
    ),
    "noise": Grade("gyro noise of 0.1 deg/s/sqrt(Hz)", _noise, draws=ERROR_DRAWS),
    "g-sensitivity": Grade("gyro that feels acceleration, 0.1 deg/s/g rms an entry", _g_sensitivity, draws=ERROR_DRAWS),
    "mpu6050": Grade(
        "MPU-6050: scale 1 %, misalignment 0.7 %, bias 1 deg/s, accelerometer 400 ug/sqrt(Hz)",
        _mpu6050,
        draws=ERROR_DRAWS,
        bias_dps=1.0,
    ),
    "accel-errors": Grade(
        "accelerometer: offset 30 mg in a drawn direction, scale 2 %, misalignment 0.5 %",
        _accel_errors,
        draws=ERROR_DRAWS,
    ),
    "mpu6050-whole": Grade(
        "MPU-6050 with the offset, scale and misalignment of its accelerometer",
        _mpu6050_whole,
        draws=ERROR_DRAWS,
        bias_dps=1.0,
    ),
    "gravity-low": Grade("accelerometer that reads 3 % too little", _gravity_low),
    "missing-0.1": Grade("0.1 % of the samples declared missing", loss=losses.share(0.001), draws=LOSS_DRAWS),
    "missing-1": Grade("1 % of the samples declared missing", loss=losses.share(0.01), draws=LOSS_DRAWS),
    "missing-10": Grade("10 % of the samples declared missing", loss=losses.share(0.1), draws=LOSS_DRAWS),
    "lost-2": Grade(
        "2 % of the samples lost without notice: the next one follows at once",
        loss=losses.share(0.02),
        declared=False,
        draws=LOSS_DRAWS,
    ),
    "gaps": Grade("declared gaps of 100 ms every 10 s", loss=losses.gaps, draws=LOSS_DRAWS),
    "clip-250": Grade("gyro clipped at +-250 deg/s", sensor=clipping(250.0, 16.0)),
    "clip-500": Grade("gyro clipped at +-500 deg/s", sensor=clipping(500.0, 16.0)),
    "accel-4g": Grade("accelerometer clipped at +-4 g", sensor=clipping(2000.0, 4.0)),
    "moving-start": Grade("started every 10 s inside the motion: seconds 2 to 10", window_s=SOON_S),
    "moving-start-later": Grade("started every 10 s inside the motion: seconds 10 to 40", window_s=LATER_S),
}
"""Name -> grade, in the order of the table."""

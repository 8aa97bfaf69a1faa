"""Counts of a three-axis gyro and accelerometer that every compared algorithm gets, and the vertical to be found.

The order is that of a real sensor: errors of the sensor (grades.py) at the recording's own rate, then the mean of each
block of 1, 3 or 6 samples, then rounding to counts, then the loss of samples. An algorithm that computes in floating
point gets the counts times their unit, so that all see the same quantised input.

Error measure: the angle between the estimated and the true vertical, both in sensor coordinates, over the samples that
are marked as movement and have a reference. An error of heading does not count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.readers import recording
from plumb.spec.tuning import Channel
from plumb.tuning.channels import NO_SAMPLE, ideal_channel

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

DECIMATIONS = (1, 3, 6)
JITTER = 0.01
"""Stamps that stray from an even grid by more of a period are resampled to it."""
COUNTS_MAX = 32_767
"""Largest count; -32768 is left out, which marks a missing sample in some systems."""
START_EVERY_S = 10.0
"""Between two starts inside a motion."""


@dataclass(frozen=True)
class Motion:
    """A recording on an even grid. gyr_dps, acc_g: (N, 3); up: true vertical in sensor coordinates, (N, 3), NaN where
    the reference is lost; movement: (N,), the samples to score; period_s: between samples."""

    name: str
    period_s: float
    gyr_dps: FloatArray
    acc_g: FloatArray
    up: FloatArray
    movement: BoolArray

    @property
    def time_s(self) -> FloatArray:
        return np.arange(len(self.gyr_dps), dtype=np.float64) * self.period_s


@dataclass(frozen=True)
class Sensor:
    """Unit of a count in deg/s and in g, and the largest count of each. beyond: counts that the sensor delivers beyond
    that range: with one, a clipped sample is known for what it is."""

    gyro: Channel
    accel: Channel
    beyond: int = 0


def ideal(full_scale_dps: float, full_scale_g: float) -> Sensor:
    """A sensor of 16 bits."""
    unit_dps, unit_g = full_scale_dps / (COUNTS_MAX + 1), full_scale_g / (COUNTS_MAX + 1)
    return Sensor(
        Channel(zero_counts=0.0, unit_per_count=unit_dps, min_counts=-COUNTS_MAX, max_counts=COUNTS_MAX),
        Channel(zero_counts=0.0, unit_per_count=unit_g, min_counts=-COUNTS_MAX, max_counts=COUNTS_MAX),
    )


def clipping(full_scale_dps: float, full_scale_g: float) -> Sensor:
    """A sensor of 16 bits whose count at either end is outside its range, as `plumb.Estimator` declares one."""
    return Sensor(ideal_channel(full_scale_dps), ideal_channel(full_scale_g), beyond=1)


SIXTEEN_BITS = ideal(2000.0, 16.0)


@dataclass(frozen=True)
class Samples:
    """counts: (N, 6) int16, gyro x, y, z, accelerometer x, y, z, in the sensor's units, the last ones again where the
    sample is lost; period_us: between samples; up: (N, 3) at the end of each block; scored: (N,); missing: (N,), the
    samples that are declared missing."""

    counts: npt.NDArray[np.int16]
    sensor: Sensor
    period_us: int
    up: FloatArray
    scored: BoolArray
    missing: BoolArray

    @property
    def marked(self) -> npt.NDArray[np.int16]:
        """The counts, -32768 where a sample is declared missing: for systems that take such marks, (N, 6)."""
        return np.where(self.missing[:, None], np.int16(NO_SAMPLE), self.counts)

    @property
    def gyr_radps(self) -> FloatArray:
        """The counts of the gyro in rad/s, (N, 3)."""
        return np.asarray(np.radians(self.counts[:, :3] * self.sensor.gyro.unit_per_count), np.float64)

    @property
    def acc_mps2(self) -> FloatArray:
        """The counts of the accelerometer in m/s^2, (N, 3)."""
        unit_mps2 = self.sensor.accel.unit_per_count * recording.G_MPS2
        return np.asarray(self.counts[:, 3:] * unit_mps2, np.float64)

    @property
    def time_s(self) -> FloatArray:
        return np.arange(len(self.counts), dtype=np.float64) * (self.period_us * 1e-6)

    def first(self, steps: int) -> Samples:
        """The first `steps` samples."""
        return _part(self, np.arange(min(steps, len(self.counts))))


@dataclass(frozen=True)
class Estimate:
    """Output of an algorithm after each sample. up: the vertical in sensor coordinates, (N, 3); sigma_deg: the standard
    deviation of the tilt that it states, root of the sum of both axes' variances, (N,); None: it states none."""

    up: FloatArray
    sigma_deg: FloatArray | None = None


def motion_of(recorded: recording.Recording) -> Motion:
    """Raises UsageError for a recording without a reference, or without a sample to score."""
    name = recorded.path.name
    if recorded.ref_quat is None:
        raise UsageError(f"{name} has no reference (ref_quat, or ref_w to ref_z): there is nothing to compare with")
    time_s, up = recorded.time_s, recording.vertical(recorded.ref_quat)
    period_s = recorded.step_s
    values, movement = np.hstack([recorded.gyr_dps, recorded.acc_g]), recorded.movement
    even_s = np.arange(len(time_s)) * period_s
    if np.max(np.abs(time_s - even_s)) > JITTER * period_s + 1e-6:
        period_us = max(round(period_s * 1e6), 1)
        values = recording.steady(time_s, values, period_us)
        even_s = np.arange(len(values)) * (period_us * 1e-6)
        nearest = np.clip(np.rint(np.interp(even_s, time_s, np.arange(len(time_s)))), 0, None).astype(int)
        up = np.stack([np.interp(even_s, time_s, column) for column in up.T], 1)
        movement, period_s = movement[nearest], period_us * 1e-6
    if not (movement & np.isfinite(up).all(axis=1)).any():
        raise UsageError(f"{name} has no sample that is marked as movement and has a reference: nothing to score")
    return Motion(recorded.path.stem, period_s, values[:, :3], values[:, 3:], up, movement)


def sampled(motion: Motion, sensor: Sensor, block: int) -> Samples:
    """The counts of a sensor that has the motion, at a rate that is `block` times lower. The reference of a block is
    that of its last sample, when an algorithm that has this block is asked."""
    blocks = len(motion.gyr_dps) // block
    last = np.arange(blocks) * block + block - 1
    limits = (sensor.gyro, sensor.accel)
    rounded = [
        np.clip(
            np.rint(recording.block_means(values, block) / one.unit_per_count),
            one.min_counts - sensor.beyond,
            one.max_counts + sensor.beyond,
        )
        for values, one in zip((motion.gyr_dps, motion.acc_g), limits, strict=True)
    ]
    up = motion.up[last]
    scored = motion.movement[last] & np.isfinite(up).all(axis=1)
    counts, period_us = np.hstack(rounded).astype(np.int16), round(motion.period_s * block * 1e6)
    return Samples(counts, sensor, period_us, up, scored, np.zeros(blocks, np.bool_))


def held(samples: Samples, lost: BoolArray) -> Samples:
    """The samples with those that are lost, (N,), declared missing: the last one again in their place. The first is
    never lost."""
    lost = lost & (np.arange(len(lost)) > 0)
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
    return replace(samples, counts=samples.counts[last], missing=lost)


def dropped(samples: Samples, lost: BoolArray) -> Samples:
    """The samples without those that are lost, (N,): the loss is not marked, and their time is missing, too."""
    return _part(samples, np.flatnonzero(~lost))


def _part(samples: Samples, at: npt.NDArray[np.intp]) -> Samples:
    counts, up, scored, missing = samples.counts[at], samples.up[at], samples.scored[at], samples.missing[at]
    return replace(samples, counts=counts, up=up, scored=scored, missing=missing)


def started_inside(samples: Samples, window_s: tuple[float, float]) -> tuple[Samples, ...]:
    """Runs that begin every START_EVERY_S inside the motion, scored from and to so many seconds after their start."""
    every, steps = round(START_EVERY_S * 1e6 / samples.period_us), len(samples.counts)
    begin, end = (round(1e6 * one / samples.period_us) for one in window_s)
    found = []
    for start in range(int(np.argmax(samples.scored)), steps, every):
        part = _part(samples, np.arange(start, min(start + end, steps)))
        scored = part.scored & (np.arange(len(part.scored)) >= begin)
        if scored.any():
            found.append(replace(part, scored=scored))
    return tuple(found)


def error_deg(estimated: FloatArray, up: FloatArray) -> FloatArray:
    """Angle between two verticals of any length, (N, 3) each -> (N,); NaN where either is."""
    across = np.linalg.norm(np.cross(estimated, up), axis=1)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(estimated * up, axis=1))), np.float64)


def vertical_of(quat: FloatArray) -> FloatArray:
    """The vertical in sensor coordinates of attitudes w, x, y, z from sensor to earth, (N, 4) -> (N, 3)."""
    return recording.vertical(quat)

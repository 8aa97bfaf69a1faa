"""What `phone` was asked to reach, and what the integers reach.

In `general` the error is the angle between the estimated and the true vertical; in `static` and `turns`, where the
source gives its tables by axis, it is the angle of that axis. Raw is the gyro alone from the true start: with Euler
rates in `general`, each axis' own rate in the source's two experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plumb import metrics, native, quantise, reference
from plumb.reference.phone import rates_of
from plumb.systems import phone
from plumb.systems.figures import Figure, Sense
from plumb.tuning import PhoneTuning

FloatArray = npt.NDArray[np.float64]
Angles = tuple[FloatArray, FloatArray]
"""Pitch and roll, deg, (steps, runs) each."""

TURN_DEG = 360.0 / 2.0**32

ASSUMED = (
    "general: angle between estimated and true vertical, rms over t >= 10 s; raw drift: the same angle at the end, gyro"
    " alone with Euler rates. Shares are of the mean raw drift. Tunings fitted on seeds 0-19.",
    f"general: bias {phone.GENERAL_BIAS_DPS[0]:g} (even seeds) and {phone.GENERAL_BIAS_DPS[1]:g} deg/s (odd), direction"
    " random: pi/4 of it tilts on average, 28.3 and 34.6 deg in 200 s (source 28.6 and 34.4).",
    f"Assumed: gyro noise {phone.GYRO_NOISE_DPS_PER_RTHZ:g} deg/s/sqrt(Hz), bias walk {phone.WALK_DPS_PER_RTS:g}"
    f" deg/s/sqrt(s), scale {100 * phone.SCALE_ERROR:g} %, accelerometer offset {phone.OFFSET_MPS2:g} m/s^2,"
    f" noise {1e6 * phone.ACCEL_NOISE_G_PER_RTHZ:g} ug/sqrt(Hz), acceleration {phone.LINEAR_MPS2:g} m/s^2 an axis.",
    "static, turns: biases by axis, residual and held error: mean of the axis' absolute error. Step noise: rms change"
    " of the error from one sample to the next.",
)


@dataclass(frozen=True)
class Batch:
    """One scenario's runs; raw (steps, 6, runs), vertical and sensed rates (3, steps, runs)."""

    runs: tuple[phone.Scenario, ...]

    @classmethod
    def of(cls, name: str, seeds: Iterable[int]) -> Batch:
        return cls(tuple(phone.scenario(name, seed) for seed in seeds))

    @cached_property
    def raw(self) -> npt.NDArray[np.int16]:
        return np.stack([run.counts() for run in self.runs], axis=-1)

    @cached_property
    def vertical(self) -> FloatArray:
        return np.stack([run.vertical for run in self.runs], axis=-1)

    @cached_property
    def rate_dps(self) -> FloatArray:
        """As sampled."""
        return np.moveaxis(self.raw[:, :3].astype(np.float64), 1, 0) * phone.GYRO.unit_per_count

    @cached_property
    def force_g(self) -> FloatArray:
        """As sampled."""
        return np.moveaxis(self.raw[:, 3:].astype(np.float64), 1, 0) * phone.ACCEL.unit_per_count

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        return self.runs[0].scored

    @property
    def truth(self) -> Angles:
        return phone.pitch_roll_deg(self.vertical)

    def integers(self, tuning: PhoneTuning) -> Angles:
        """The C integers, run by run: a record of every word of all runs would be too large."""
        params, zeros = quantise.quantise(tuning), np.zeros(len(self.raw), np.int32)
        pitch, roll = np.empty((2, len(self.raw), len(self.runs)))
        for run in range(len(self.runs)):
            words = native.run_control(params, self.raw[:, :, run], zeros)
            pitch[:, run], roll[:, run] = words["pitch_turn_q32"] * TURN_DEG, words["roll_turn_q32"] * TURN_DEG
        return pitch, roll

    def float64(self, tuning: PhoneTuning) -> Angles:
        angles = reference.run_control(tuning, self.raw)
        return angles["pitch_deg"], angles["roll_deg"]

    def axis_rates_only(self) -> Angles:
        """The gyro alone, each axis' own rate summed from 0."""
        period_s = self.runs[0].period_us * 1e-6
        return np.cumsum(self.rate_dps[1], axis=0) * period_s, np.cumsum(self.rate_dps[0], axis=0) * period_s

    def euler_rates_only(self) -> Angles:
        """The gyro alone with Euler rates, from level."""
        period_s = self.runs[0].period_us * 1e-6
        pitch, roll = np.zeros((2, len(self.raw), len(self.runs)))
        nowhere = np.zeros(len(self.runs), bool)
        for k in range(1, len(self.raw)):
            rates = rates_of(phone.EULER, pitch[k - 1], roll[k - 1], self.rate_dps[:, k - 1], nowhere)
            pitch[k], roll[k] = pitch[k - 1] + period_s * rates[0], roll[k - 1] + period_s * rates[1]
        return pitch, roll

    def error_deg(self, angles: Angles) -> FloatArray:
        """Between the verticals, (steps, runs)."""
        return phone.inclination_deg(phone.up(*angles), self.vertical)

    def rms_deg(self, vertical: FloatArray) -> FloatArray:
        """Error of a vertical over the samples that count, (runs,)."""
        error = phone.inclination_deg(vertical, self.vertical)[self.scored]
        return np.asarray(np.sqrt(np.mean(error**2, axis=0)))

    def step_noise(self, vertical: FloatArray) -> FloatArray:
        """Rms change of the error of a vertical of unit length from sample to sample, (runs,)."""
        steps = np.diff(vertical / np.linalg.norm(vertical, axis=0) - self.vertical, axis=1)[:, self.scored[1:]]
        return np.asarray(np.sqrt(np.mean(np.sum(steps**2, axis=0), axis=0)))


def general_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Everything at once: raw, as printed, with Euler rates."""
    batch = Batch.of("general", seeds)
    alone = batch.rms_deg(batch.force_g)
    yield Figure(
        "accelerometer only (source: the scenario's own figure)", "general", "-", "deg rms", "near", 8.3,
        float(np.mean(alone)), float(np.max(alone)),
    )  # fmt: skip
    drift_deg = float(np.mean(batch.error_deg(batch.euler_rates_only())[-1]))
    rows: tuple[tuple[str, str, Sense, float], ...] = (
        ("as printed, share of raw drift (source: about 20)", "printed", "near", 20.0),
        ("with Euler rates, share of raw drift (source: about 4)", "euler", "at most", 4.5),
    )
    for claim, name, sense, reach in rows:
        tuning = phone.TUNINGS[name]
        angles = batch.integers(tuning)
        error = batch.rms_deg(phone.up(*angles))
        ideal = float(np.mean(batch.rms_deg(phone.up(*batch.float64(tuning)))))
        shares = (float(np.mean(error)), float(np.max(error)), ideal, float(np.mean(alone)), drift_deg)
        mean, worst, ideal, accel, gyro = (100.0 * value / drift_deg for value in shares)
        yield Figure(claim, "general", name, "%", sense, reach, mean, worst, ideal, accel, gyro)
    yield _quieter(batch, angles, 80.0, "step noise, below accelerometer (source: about 70)")


def static_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The source's first table: 100 s at rest."""
    batch = Batch.of("static", seeds)
    raw = np.abs(np.stack(batch.axis_rates_only())[:, -1])
    yield Figure(
        "raw drift in 100 s (source 28.3)", "static", "-", "deg", "near", 28.3, float(np.mean(raw)), float(np.max(raw))
    )
    angles = batch.integers(phone.EULER)
    residual, ideal = (_mean_abs(batch, found) for found in (angles, batch.float64(phone.EULER)))
    accel = _mean_abs(batch, phone.pitch_roll_deg(batch.force_g))
    shares = (float(np.mean(residual)), float(np.max(residual)), float(np.mean(ideal)), float(np.mean(accel)))
    mean, worst, ideal_mean, accel_mean = (100.0 * value / float(np.mean(raw)) for value in shares)
    claim = "residual, share of raw drift (source: about 4)"
    yield Figure(claim, "static", "euler", "%", "at most", 1.0, mean, worst, ideal_mean, accel_mean, 100.0)
    yield _quieter(batch, angles, 70.0, "step noise, below accelerometer (source: about 70)")


def turns_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The source's second table: 200 s with turns of 90 degrees."""
    batch = Batch.of("turns", seeds)
    raw = dict(zip(("pitch", "roll"), batch.axis_rates_only(), strict=True))
    for axis, drift in (("pitch", 28.6), ("roll", 34.4)):
        end = np.abs(raw[axis][-1])
        claim = f"raw drift of {axis} in 200 s (source {drift:g})"
        yield Figure(claim, "turns", "-", "deg", "near", drift, float(np.mean(end)), float(np.max(end)))
    for name, reach in (("printed", 4.0), ("euler", 1.0)):
        tuning = phone.TUNINGS[name]
        ours, ideal, accel = (
            dict(zip(("pitch", "roll"), angles, strict=True))
            for angles in (batch.integers(tuning), batch.float64(tuning), phone.pitch_roll_deg(batch.force_g))
        )
        for axis, held in batch.runs[0].held().items():
            off = [
                100.0 / phone.TURN_DEG * np.mean(np.abs(metrics.wrap_deg(found[axis][held] - phone.TURN_DEG)), axis=0)
                for found in (ours, ideal, accel, raw)
            ]
            mean, ideal_mean, accel_mean, raw_mean = (float(np.mean(value)) for value in off)
            claim = f"{axis} held at 90 deg, error as a share of it (source: about 4)"
            worst = float(np.max(off[0]))
            yield Figure(claim, "turns", name, "%", "at most", reach, mean, worst, ideal_mean, accel_mean, raw_mean)


def _mean_abs(batch: Batch, angles: Angles) -> FloatArray:
    """Mean absolute error of both angles over the samples that count, (runs,)."""
    errors = [metrics.wrap_deg(angle - truth)[batch.scored] for angle, truth in zip(angles, batch.truth, strict=True)]
    return np.asarray(np.mean(np.abs(np.stack(errors)), axis=(0, 1)))


def _quieter(batch: Batch, angles: Angles, reach: float, claim: str) -> Figure:
    ours, accel = batch.step_noise(phone.up(*angles)), batch.step_noise(batch.force_g)
    less = 100.0 * (1.0 - ours / accel)
    name = batch.runs[0].name
    return Figure(claim, name, "euler", "%", "at least", reach, float(np.mean(less)), float(np.min(less)))


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "general": general_rows,
    "static": static_rows,
    "turns": turns_rows,
}

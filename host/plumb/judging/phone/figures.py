"""Targets of `phone` and the figures that the integers reach; the source's two tables and their plots.

In `general` the error is the angle between the estimated and the true vertical. In `static` and `turns`, for which the
source gives tables by axis, it is the error of that axis. Raw is the gyro alone from the true initial state: with Euler
rates in `general`, with the body rate of each axis in the source's two experiments. `printed` is the source's filter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.contract import run_reference
from plumb.contract.parameters import quantise
from plumb.kernels.reference.blending import complementary_step, weighted_average
from plumb.proof import metrics
from plumb.proof.figures import Figure, Sense
from plumb.proof.limits import Limits
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot
from plumb.spec.arrays import FloatArray
from plumb.systems.phone import scenarios as phone
from plumb.systems.phone.reference import rates_of
from plumb.systems.phone.tuning import PhoneTuning

Angles = tuple[FloatArray, FloatArray]
"""Pitch and roll, deg, (steps, runs) each."""

TURN_DEG = 360.0 / 2.0**32
AXES = ("pitch", "roll")
HEADLINE = ("with Euler rates, share of raw drift", "general", "euler")
PLOTTED_SEED, GENERAL_SHOWN_S = 1000, 60.0

NAMED = {"printed": "as printed", "euler": "with Euler rates"}
"""Tuning -> its name in the rows, the source's own first."""
COLOURS = {"printed": SECOND, "euler": ESTIMATE}
LEFT_OVER, QUIETER = "about 4 %", "about 70 %"
"""The source's claims for its filter in both experiments: remaining error, and reduction of noise."""
LAST_S = 10.0
"""`turns`: time at the end, flat again, over which the remaining error is averaged."""

BLENDED = {"general": (2.5, 0.2), "static": (0.05, 0.0002)}
"""Scenario -> time constant of the complementary filter in s, weight of the gyro in the weighted average; fitted on
seeds 0-19."""

ASSUMED = (
    "general: angle between estimated and true vertical, rms over t >= 10 s; raw drift: the same angle at the end, gyro"
    " alone with Euler rates. Shares are of the mean raw drift. Tunings fitted on seeds 0-19.",
    f"general: bias {phone.GENERAL_BIAS_DPS[0]:g} (even seeds) and {phone.GENERAL_BIAS_DPS[1]:g} deg/s (odd), direction"
    " random: pi/4 of it tilts on average, 28.3 and 34.6 deg in 200 s (source 28.6 and 34.4).",
    f"Assumed: gyro noise {phone.GYRO_NOISE_DPS_PER_RTHZ:g} deg/s/sqrt(Hz), bias walk {phone.WALK_DPS_PER_RTS:g}"
    f" deg/s/sqrt(s), scale {100 * phone.SCALE_ERROR:g} %, accelerometer offset {phone.OFFSET_MPS2:g} m/s^2,"
    f" noise {1e6 * phone.ACCEL_NOISE_G_PER_RTHZ:g} ug/sqrt(Hz), acceleration {phone.LINEAR_MPS2:g} m/s^2 an axis.",
    "static, turns: biases by axis; residual, held, left: mean of the axis' absolute error, `left` over the last"
    f" {LAST_S:g} s. Step noise: rms change of the vertical's error from one sample to the next.",
    "Complementary filter and weighted average, which the firmware does not have: float64, Euler rates, gyro as in raw"
    " drift (its bias stays), constants fitted on seeds 0-19 of the scenario.",
    "The source does not say what its 4 % are a share of: both readings stand here, the raw drift and the 90 deg.",
)


LIMITS: Limits = {}
"""Empty: the targets are shares of the mean drift over many seeds, which a single run does not have."""


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
        params, zeros = quantise(tuning), np.zeros(len(self.raw), np.int32)
        pitch, roll = np.empty((2, len(self.raw), len(self.runs)))
        for run in range(len(self.runs)):
            words = native_core.run_control(params, self.raw[:, :, run], zeros)
            pitch[:, run], roll[:, run] = words["pitch_turn_q32"] * TURN_DEG, words["roll_turn_q32"] * TURN_DEG
        return pitch, roll

    def float64(self, tuning: PhoneTuning) -> Angles:
        angles = run_reference.run_control(tuning, self.raw)
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

    def complementary(self, tau_s: float) -> Angles:
        """The complementary filter of each angle, from level, with Euler rates of the angles as last estimated."""
        period_s, nowhere = self.runs[0].period_us * 1e-6, np.zeros(len(self.runs), bool)
        measured, found = phone.pitch_roll_deg(self.force_g), np.zeros((2, len(self.raw), len(self.runs)))
        for k in range(1, len(self.raw)):
            rates = rates_of(phone.EULER, found[0, k - 1], found[1, k - 1], self.rate_dps[:, k - 1], nowhere)
            for i in range(2):
                found[i, k] = complementary_step(found[i, k - 1], rates[i], measured[i][k], period_s, tau_s)
        return found[0], found[1]

    def averaged(self, weight: float) -> Angles:
        """The weighted average of gyro alone and accelerometer alone."""
        gyro, accel = self.euler_rates_only(), phone.pitch_roll_deg(self.force_g)
        return weighted_average(gyro[0], accel[0], weight), weighted_average(gyro[1], accel[1], weight)

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
        "accelerometer only (the scenario's own figure)", "general", "-", "deg rms", "near", 8.3,
        float(np.mean(alone)), float(np.max(alone)),
    ).over(alone)  # fmt: skip
    drift, body = (batch.error_deg(found)[-1] for found in (batch.euler_rates_only(), batch.axis_rates_only()))
    yield _drift("raw drift in 200 s, Euler rates", "general", drift, sense="compared", source="28.6, 34.4 deg")
    yield _drift("raw drift in 200 s, body rates", "general", body)
    drift_deg = float(np.mean(drift))
    marks: dict[str, tuple[Sense, float, Sense, float]] = {
        "printed": ("about", 20.0, "compared", 0.0),
        "euler": ("at most", 4.5, "at least", 80.0),
    }
    for name, (sense, reach, quieter, by) in marks.items():
        tuning = phone.TUNINGS[name]
        angles = batch.integers(tuning)
        error = batch.rms_deg(phone.up(*angles))
        ideal = batch.rms_deg(phone.up(*batch.float64(tuning)))
        claim = f"{NAMED[name]}, share of raw drift"
        yield _share(claim, batch, name, sense, reach, drift_deg, (error, ideal, alone, drift))
        yield _quieter(batch, name, angles, quieter, by)


def blended_rows(seeds: Iterable[int], scenarios: Iterable[str] = tuple(BLENDED)) -> Iterator[Figure]:
    """Complementary filter and weighted average, the source's alternatives to the Kalman filter, at their best."""
    for name in scenarios:
        tau_s, weight = BLENDED[name]
        batch = Batch.of(name, seeds)
        general = name == "general"
        raw = batch.error_deg(batch.euler_rates_only())[-1] if general else np.abs(batch.axis_rates_only())[:, -1]
        drift_deg = float(np.mean(raw))
        for claim, constant, angles in (
            ("complementary filter, float64", f"tau {tau_s:g} s", batch.complementary(tau_s)),
            ("weighted average, float64", f"gyro {weight:g}", batch.averaged(weight)),
        ):
            error = batch.rms_deg(phone.up(*angles)) if general else _mean_abs(batch, angles)
            share = 100.0 / drift_deg * error
            reached = float(np.mean(share))
            yield Figure(
                f"{claim}, share of raw drift", name, constant, "%", "shown", 0.0, reached, float(np.max(share)),
                reached,
            ).over(share)  # fmt: skip


def static_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The source's first table: 100 s at rest."""
    batch = Batch.of("static", seeds)
    raw = np.abs(np.stack(batch.axis_rates_only())[:, -1])
    yield _drift("raw drift in 100 s", "static", raw, 28.3)
    alone = _mean_abs(batch, phone.pitch_roll_deg(batch.force_g))
    for name, called in NAMED.items():
        tuning = phone.TUNINGS[name]
        angles = batch.integers(tuning)
        error, ideal = (_mean_abs(batch, found) for found in (angles, batch.float64(tuning)))
        claim, of_deg = f"{called}, residual, share of raw drift", float(np.mean(raw))
        yield _share(claim, batch, name, "at most", 1.0, of_deg, (error, ideal, alone, raw), LEFT_OVER)
        yield _quieter(batch, name, angles, "at least", 70.0, QUIETER)


def turns_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The source's second table: 200 s with turns of 90 degrees."""
    batch = Batch.of("turns", seeds)
    raw = batch.axis_rates_only()
    ends_deg = [np.abs(angle[-1]) for angle in raw]
    for axis, end, source_deg in zip(AXES, ends_deg, (28.6, 34.4), strict=True):
        yield _drift(f"raw drift of {axis} in 200 s", "turns", end, source_deg)
    time_s, held = batch.runs[0].time_s, batch.runs[0].held()
    last = time_s >= time_s[-1] - LAST_S
    for name, called in NAMED.items():
        tuning = phone.TUNINGS[name]
        found = (batch.integers(tuning), batch.float64(tuning), phone.pitch_roll_deg(batch.force_g), raw)
        for i, axis in enumerate(AXES):
            off = [np.abs(metrics.wrap_deg(angles[i] - batch.truth[i])) for angles in found]
            while_held, at_last = ([np.mean(one[when], axis=0) for one in off] for when in (held[axis], last))
            claim = f"{called}, {axis} held at 90 deg, share of it"
            yield _share(claim, batch, name, "at most", 1.0, phone.TURN_DEG, while_held, LEFT_OVER)
            claim, of_deg = f"{called}, {axis} left at the end, share of raw drift", float(np.mean(ends_deg[i]))
            yield _share(claim, batch, name, "shown", 0.0, of_deg, at_last, LEFT_OVER)
            honest: Sense = "compared" if axis == "roll" else "shown"
            most, ideal, alone, gyro = (np.max(one[batch.scored], axis=0) for one in off)
            yield Figure(
                f"{called}, largest error of {axis}", "turns", name, "deg", honest, 0.0, float(np.mean(most)),
                float(np.max(most)), float(np.mean(ideal)), float(np.mean(alone)), float(np.mean(gyro)),
            ).over(most)  # fmt: skip
        yield _quieter(batch, name, found[0], "at least", 70.0, QUIETER)


def _drift(
    claim: str, scenario: str, deg: FloatArray, near_deg: float = 0.0, sense: Sense = "shown", source: str = ""
) -> Figure:
    """Drift of the gyro alone, at the end. near_deg: the source's, where the scenario is its experiment."""
    if near_deg:
        sense, source = "near", f"{near_deg:g} deg"
    row = Figure(claim, scenario, "-", "deg", sense, near_deg, float(np.mean(deg)), float(np.max(deg)), source=source)
    return row.over(deg)


def _share(
    claim: str, batch: Batch, name: str, sense: Sense, reach: float, of_deg: float, found: Sequence[FloatArray],
    source: str = "",
) -> Figure:  # fmt: skip
    """found: error of every run, deg, of the integers, float64, accelerometer alone, gyro alone; in % of of_deg."""
    reached, ideal, accel, gyro = (100.0 / of_deg * float(np.mean(error)) for error in found)
    worst = 100.0 / of_deg * float(np.max(found[0]))
    row = Figure(claim, batch.runs[0].name, name, "%", sense, reach, reached, worst, ideal, accel, gyro, source)
    return row.over(100.0 / of_deg * found[0])


def _mean_abs(batch: Batch, angles: Angles) -> FloatArray:
    """Mean absolute error of both angles over the samples that count, (runs,)."""
    errors = [metrics.wrap_deg(angle - truth)[batch.scored] for angle, truth in zip(angles, batch.truth, strict=True)]
    return np.asarray(np.mean(np.abs(np.stack(errors)), axis=(0, 1)))


def _quieter(batch: Batch, name: str, angles: Angles, sense: Sense, reach: float, source: str = "") -> Figure:
    """How far the noise from step to step lies below the accelerometer's; worst is the least."""
    less = 100.0 * (1.0 - batch.step_noise(phone.up(*angles)) / batch.step_noise(batch.force_g))
    claim = f"{NAMED[name]}, step noise, below accelerometer"
    mean, worst = float(np.mean(less)), float(np.min(less))
    return Figure(claim, batch.runs[0].name, name, "%", sense, reach, mean, worst, source=source).over(less)


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "general": general_rows,
    "static": static_rows,
    "turns": turns_rows,
    "blended": blended_rows,
}


def static_plots() -> list[Plot]:
    """The source's first experiment: the gyro alone drifts, the filters do not."""
    batch = Batch.of("static", [PLOTTED_SEED])
    raw, found = batch.axis_rates_only(), {name: batch.integers(phone.TUNINGS[name]) for name in NAMED}
    alone = phone.pitch_roll_deg(batch.force_g)
    panels = []
    for i, axis in enumerate(AXES):
        lines = [Line("gyro alone", raw[i][:, 0], SENSOR), Line(NAMED["euler"], found["euler"][i][:, 0], ESTIMATE)]
        panels.append(Plot(f"At rest, {axis}", "deg", batch.runs[0].time_s, lines))
    lines = [Line("accelerometer only", alone[0][:, 0], SENSOR, 0.5)]
    lines += [Line(NAMED[name], found[name][0][:, 0], colour) for name, colour in COLOURS.items()]
    panels.append(Plot("The same at rest, pitch, near 0", "deg", batch.runs[0].time_s, lines))
    return panels


def turns_plots() -> list[Plot]:
    """The source's second experiment: 90 degrees about x, then about y."""
    batch = Batch.of("turns", [PLOTTED_SEED])
    raw, found = batch.axis_rates_only(), {name: batch.integers(phone.TUNINGS[name]) for name in NAMED}
    time_s, panels = batch.runs[0].time_s, []
    for i, axis in enumerate(AXES):
        lines = [Line("gyro alone", raw[i][:, 0], SENSOR), Line("true", batch.truth[i][:, 0], TRUTH, 1.6)]
        lines.append(Line(NAMED["euler"], found["euler"][i][:, 0], ESTIMATE))
        panels.append(Plot(f"Turned, {axis}", "deg", time_s, lines))
    for i, axis in enumerate(AXES):
        off = {name: metrics.wrap_deg(found[name][i] - batch.truth[i])[:, 0] for name in NAMED}
        lines = [Line(NAMED[name], off[name], colour) for name, colour in COLOURS.items()]
        panels.append(Plot(f"Error of {axis}", "deg", time_s, lines))
    return panels


def general_plots() -> list[Plot]:
    """Yaw, pitch and roll together: body rates differ from Euler rates."""
    batch = Batch.of("general", [PLOTTED_SEED])
    found = {name: batch.integers(phone.TUNINGS[name]) for name in NAMED}
    time_s, panels = batch.runs[0].time_s, []
    early = time_s < GENERAL_SHOWN_S
    for i, axis in enumerate(AXES):
        lines = [Line(NAMED[name], found[name][i][early, 0], colour) for name, colour in COLOURS.items()]
        lines.insert(1, Line("true", batch.truth[i][early, 0], TRUTH, 1.6))
        panels.append(Plot(f"General motion, {axis}, the first minute", "deg", time_s[early], lines))
    lines = [Line(NAMED[name], batch.error_deg(found[name])[:, 0], colour) for name, colour in COLOURS.items()]
    lines.append(Line("gyro alone with Euler rates", batch.error_deg(batch.euler_rates_only())[:, 0], SENSOR, 1.6))
    return [*panels, Plot("Error of the vertical", "deg", time_s, lines)]


PLOTS: dict[str, Callable[[], list[Plot]]] = {
    "static": static_plots,
    "turns": turns_plots,
    "general": general_plots,
}

"""Targets of `turntable` and the figures that the integers reach (see plumb.proof.figures).

Residuals are rotation-vector components of truth^-1 * estimate over the motion. Mean: of the absolute values over time
and axes; maximum: of each axis over time, then the mean of the axes. A row in % of the gyro's divides the mean of all
seeds by that of the gyro alone without its spikes, which is the strictest comparison: 100 % is no better than the gyro.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.judging.turntable import gyro as turntable_gyro
from plumb.judging.turntable.plots import RATE_DPS, attitude, reference_attitude
from plumb.proof import intervals
from plumb.proof.figures import UNASKED, Figure, Sense
from plumb.proof.limits import Limit
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot
from plumb.proof.xy_plot import Axis, Curve, XyPlot
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.turntable import reference as reference_turntable
from plumb.systems.turntable import scenarios as turntable
from plumb.systems.turntable.motion import REST_S
from plumb.systems.turntable.reference import rotation_deg

Series = npt.NDArray[np.floating[Any]]  # Any: of any width

PATENT_SHARE = 79.19, 64.96
"""Mean and maximum of the data layer in % of the gyro alone: the source claims 20.81 % and 35.04 % less."""
GYROS = "% of gyro's"
MANY, TOGETHER = 10, 40
"""The headline is over so many blocks of at most 40 seeds, because how much fusion gains depends on the scales that
were drawn. The float64 reference runs as many at once: its states of hundreds would fill the memory of a machine."""
HEADLINE = ("data layer, seeds 1000-1399, mean", "motion", "data")

ASSUMED = (
    "Residuals: components of the rotation vector from truth to estimate, 10 s at rest left out. Mean over time and"
    " axes; max per axis over time, then the mean of the axes; % of the mean over seeds. Tunings fitted on seeds 0-19.",
    "The gyro alone: bias from the 10 s at rest, trapezium, its spikes taken out without a trace. `lag undone`: the"
    " same and lag * rate on the angle.",
    "Assumed: gyro 0.03 deg/s/sqrt(Hz), lag 8 ms, bias +-1 deg/s; angular accelerometer 0.3 deg/s^2/sqrt(Hz), bias +-2"
    " deg/s^2; walks 0.003, scales 0.5 %, spikes of 20 sigma in 0.5 % of the samples of both; fade: raised cosine.",
    "What fusion adds to `lag undone` is the gyro's scale, as far as the independent scale of the other sensor shows"
    " it: half of the difference is each one's, so which scales are drawn matters: the headline is over ten blocks of"
    " up to 40 seeds, and `least`, `most` are the outer ones of them. With scale and lag not estimated it adds nothing"
    " to the angle: there the gain is the lag's alone.",
    "white: nothing but noise, so that there is neither scale nor lag to estimate (`known`); `data`, which estimates"
    " both all the same, is listed with it.",
    "untrimmed: the patent's figures earned without any lag: scale error of the gyro 1.5 % (data sheet: +-3 %), of the"
    " angular accelerometer 0.5 %.",
)


LIMITS = {
    ("motion", "data", "open"): (
        Limit("below_gyro_mean_percent", "at least", 25.0, "%"),
        Limit("below_gyro_max_percent", "at least", 27.0, "%"),
    ),
}


@dataclass(frozen=True)
class Residual:
    """Mean and maximum of every run, (runs,) each, deg."""

    mean: FloatArray
    maximum: FloatArray

    @classmethod
    def of(cls, runs: Iterable[FloatArray]) -> Residual:
        """runs: (samples, 3) each."""
        pairs = [(np.mean(np.abs(run)), np.mean(np.max(np.abs(run), axis=0))) for run in runs]
        mean, maximum = np.array(pairs, np.float64).T
        return cls(mean, maximum)

    @classmethod
    def joined(cls, parts: Sequence[Residual]) -> Residual:
        """The runs of all parts."""
        return cls(np.concatenate([part.mean for part in parts]), np.concatenate([part.maximum for part in parts]))

    def share_of(self, mark: Residual) -> tuple[float, float]:
        """Mean and maximum, in % of another's."""
        return (
            100.0 * float(np.mean(self.mean)) / float(np.mean(mark.mean)),
            100.0 * float(np.mean(self.maximum)) / float(np.mean(mark.maximum)),
        )


@dataclass(frozen=True)
class Batch:
    """The runs of a scenario."""

    runs: tuple[turntable.Scenario, ...]

    @classmethod
    def of(cls, name: str, seeds: Iterable[int]) -> Batch:
        return cls(tuple(turntable.scenario(name, seed) for seed in seeds))

    @cached_property
    def gyro(self) -> Residual:
        return Residual.of(turntable_gyro.residuals_deg(run) for run in self.runs)

    def lag_undone(self, lag_s: float = 0.008) -> Residual:
        return Residual.of(turntable_gyro.residuals_deg(run, lag_s=lag_s) for run in self.runs)

    def words(self, tuning: str, run: turntable.Scenario) -> Words:
        """Records of the C integers."""
        return native_core.run_control(quantise(run.fit(turntable.TUNINGS[tuning])), run.counts(), run.setpoint())

    def integers(self, tuning: str) -> Residual:
        return Residual.of(residuals(run, attitude(self.words(tuning, run))) for run in self.runs)

    def float64(self, tuning: str, rule: reference_turntable.Rule = "trapezium") -> Residual:
        """`plumb.contract.run_reference` on the same counts."""
        return Residual.joined([part._float64(tuning, rule) for part in self._parts()])

    def _float64(self, tuning: str, rule: reference_turntable.Rule) -> Residual:
        attitudes = np.moveaxis(reference_attitude(self._reference(tuning, rule)), 1, 0)
        return Residual.of(residuals(run, one) for run, one in zip(self.runs, attitudes, strict=True))

    def _parts(self) -> Iterator[Batch]:
        for first in range(0, len(self.runs), TOGETHER):
            yield Batch(self.runs[first : first + TOGETHER])

    def _reference(self, tuning: str, rule: reference_turntable.Rule = "trapezium") -> dict[str, FloatArray]:
        raw = np.stack([run.counts() for run in self.runs], axis=-1)
        phase_s = [run.gyro_s[0] for run in self.runs]
        return reference_turntable.run_control(turntable.TUNINGS[tuning], raw, gyro_phase_s=phase_s, rule=rule)

    def rate_noise_dps(self, tuning: str) -> FloatArray:
        """Error of the integers' corrected rate over the motion, rms, (runs,)."""
        errors = []
        for run in self.runs:
            words = self.words(tuning, run)
            errors.append(rate_error_dps(run, [words[f"rate_corrected_turnps_q28_{i}"] * RATE_DPS for i in range(3)]))
        return np.array(errors)

    def float64_rate_noise_dps(self, tuning: str) -> FloatArray:
        """The same of `plumb.contract.run_reference`."""
        return np.concatenate([part._float64_rate_noise_dps(tuning) for part in self._parts()])

    def _float64_rate_noise_dps(self, tuning: str) -> FloatArray:
        found = self._reference(tuning)
        rates = [found[f"rate_dps_{i}"] for i in range(3)]
        return np.array([rate_error_dps(run, [rate[:, k] for rate in rates]) for k, run in enumerate(self.runs)])


def rate_error_dps(run: turntable.Scenario, rates_dps: Sequence[Series]) -> float:
    """Rms over the motion and the axes."""
    return float(np.sqrt(np.mean((np.stack(rates_dps, axis=-1) - run.rate_dps)[run.scored] ** 2)))


def residuals(run: turntable.Scenario, estimate: FloatArray) -> FloatArray:
    """Over the motion, (samples, 3)."""
    return rotation_deg(run.attitude[run.scored], estimate[run.scored])


def share_rows(
    claim: str, batch: Batch, name: str, tuning: str, sense: Sense, reach: tuple[float, float], source: bool = False
) -> Iterator[Figure]:
    """Two rows: mean and maximum of the residual, in % of that of the gyro alone."""
    ideal = None if sense in UNASKED else batch.float64(tuning).share_of(batch.gyro)
    yield from rows(claim, batch.integers(tuning), batch.gyro, name, tuning, sense, reach, source, ideal)


def rows(
    claim: str, found: Residual, gyro: Residual, name: str, tuning: str, sense: Sense, reach: tuple[float, float],
    source: bool = False, ideal: tuple[float, float] | None = None,
) -> Iterator[Figure]:  # fmt: skip
    """Mean and maximum; worst: of any seed, against the gyro's of that seed; ideal: the same in float64."""
    worst = 100.0 * float(np.max(found.mean / gyro.mean)), 100.0 * float(np.max(found.maximum / gyro.maximum))
    claims = tuple(f"{percent:g} %" for percent in PATENT_SHARE) if source else ("", "")
    spans = intervals.share(found.mean, gyro.mean), intervals.share(found.maximum, gyro.maximum)
    for i, kind in enumerate(("mean", "max")):
        yield Figure(
            f"{claim}, {kind}", name, tuning, GYROS, sense, reach[i], found.share_of(gyro)[i], worst[i],
            None if ideal is None else ideal[i], source=claims[i],
        ).between(spans[i])  # fmt: skip


def honest_rows(batch: Batch, name: str, lags: bool = True, sense: Sense = "shown") -> Iterator[Figure]:
    """Comparison rows: the gyro alone, the gyro with its known lag compensated, and the data layer as printed. A gyro
    without lag has no compensated row."""
    for kind, alone in (("mean", batch.gyro.mean), ("max", batch.gyro.maximum)):
        claim = f"gyro alone, {kind}"
        row = Figure(claim, name, "-", "deg", sense, 0.0, float(np.mean(alone)), float(np.max(alone)))
        yield row.over(alone)
    if lags:
        yield from rows(
            "gyro alone, its known lag undone", batch.lag_undone(), batch.gyro, name, "-", sense, (0.0, 0.0)
        )
        yield from share_rows("as printed, known lag undone", batch, name, "printed", sense, (0.0, 0.0))
    yield from share_rows("data layer exactly as printed", batch, name, "printed_lagging", sense, (0.0, 0.0))


def motion_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The 20 s run: rows with targets, and the comparison rows."""
    batch, nothing = Batch.of("motion", seeds), (0.0, 0.0)
    data_mean, data_max = (100.0 - limit.value for limit in LIMITS["motion", "data", "open"])
    yield from share_rows("data layer", batch, "motion", "data", "at most", (data_mean, data_max), source=True)
    yield from honest_rows(batch, "motion", sense="compared")
    for claim, tuning in (
        ("data layer, scale and lag not estimated", "known"),
        ("behind a noise prefilter", "smoothed"),
    ):
        yield from share_rows(claim, batch, "motion", tuning, "shown", nothing)
    yield from share_rows(
        "attitude layer, no worse than the gyro", batch, "motion", "attitude", "at most", (100.0, 100.0)
    )
    clean = Batch.of("clean", seeds)
    cost = np.subtract(batch.integers("data").share_of(batch.gyro), clean.integers("data").share_of(batch.gyro))
    yield Figure("spikes cost, mean", "motion", "data", "points", "at most", 5.0, float(cost[0]))
    yield Figure("spikes cost, max", "motion", "data", "points", "at most", 5.0, float(cost[1]))


def many_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The headline over MANY blocks of the seeds, or all seeds if they are more, so that the blocks' scatter shows."""
    first, *rest = seeds
    count = min(1 + len(rest), TOGETHER)
    last = first + max(MANY * count, 1 + len(rest))
    found: dict[str, list[Residual]] = {"data": [], "loose_angular": [], "-": []}
    alone = []
    for start in range(first, last, count):
        batch = Batch.of("motion", range(start, min(start + count, last)))
        alone.append(batch.gyro)
        for tuning, blocks in found.items():
            blocks.append(batch.lag_undone() if tuning == "-" else batch.integers(tuning))
    drawn, gyro = f"seeds {first}-{last - 1}", Residual.joined(alone)
    limits = LIMITS["motion", "data", "open"]
    reach = (100.0 - limits[0].value, 100.0 - limits[1].value)
    rows_of = {tuning: Residual.joined(blocks) for tuning, blocks in found.items()}
    yield from rows(f"data layer, {drawn}", rows_of["data"], gyro, "motion", "data", "at most", reach, source=True)
    shares = [block.share_of(mark)[0] for block, mark in zip(found["data"], alone, strict=True)]
    for which, value in (("least", min(shares)), ("most", max(shares))):
        claim = f"the same, {which} of {len(alone)} blocks of {count}, mean"
        yield Figure(claim, "motion", "data", GYROS, "compared", 0.0, value)
    for claim, tuning in (("lag undone", "-"), ("3 % of scale error believed", "loose_angular")):
        yield from rows(f"{claim}, {drawn}", rows_of[tuning], gyro, "motion", tuning, "shown", (0.0, 0.0))


def belief_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """An angular accelerometer, then a gyro, whose scale is 3 % wrong where the filter believes 0.5 %."""
    runs = list(seeds)
    for sensor in ("angular", "gyro"):
        condition: dict[str, Any] = {f"{sensor}_scale": 0.03}  # Any: mypy fits ** to every argument
        batch = Batch(tuple(turntable.scenario("motion", seed, **condition) for seed in runs))
        name, nothing = f"motion, {sensor}_scale=0.03", (0.0, 0.0)
        yield from rows("gyro alone, its known lag undone", batch.lag_undone(), batch.gyro, name, "-", "shown", nothing)
        for claim, tuning in (("0.5 % believed", "data"), ("3 % of the angular one believed", "loose_angular")):
            sense: Sense = "compared" if sensor == "angular" else "shown"
            yield from rows(claim, batch.integers(tuning), batch.gyro, name, tuning, sense, nothing)


def rule_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Angular acceleration summed by rectangles, as the patent prints it, compared with the trapezium: both in
    float64."""
    batch, nothing = Batch.of("motion", seeds), (0.0, 0.0)
    for tuning, layer in (("printed", "as printed, known lag undone"), ("data", "data layer")):
        rules: tuple[reference_turntable.Rule, ...] = ("rectangle", "trapezium")
        for rule in rules:
            found = batch.float64(tuning, rule)
            claim = f"{layer}, {rule}, float64"
            yield from rows(claim, found, batch.gyro, "motion", tuning, "shown", nothing)


def lag_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Rows with a lag setting that is 30 % too short, and with a gyro without lag."""
    batch, nothing = Batch.of("motion", seeds), (0.0, 0.0)
    short = 0.7 * 0.008
    yield from share_rows("lag 30 % short, estimated", batch, "motion", "short_lag", "shown", nothing)
    yield from share_rows("lag 30 % short, believed", batch, "motion", "short_lag_known", "shown", nothing)
    yield from rows("gyro, lag 30 % short undone", batch.lag_undone(short), batch.gyro, "motion", "-", "shown", nothing)
    none = Batch.of("no_lag", seeds)
    yield from honest_rows(none, "no_lag", lags=False)
    yield from share_rows("no lag: data layer", none, "no_lag", "no_lag", "shown", nothing)
    yield from share_rows("no lag: attitude layer", none, "no_lag", "no_lag_attitude", "shown", nothing)
    yield from share_rows("no lag, but 8 ms believed at first", none, "no_lag", "data", "shown", nothing)


def white_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """White noise alone: fusion improves the rate; it cannot improve the angle."""
    batch = Batch.of("white", seeds)
    sampled = turntable.ERRORS["white"].gyro_dps / math.sqrt(turntable.GYRO_PERIOD_S)
    marks: tuple[tuple[str, str, Sense, float], ...] = (
        ("known", "rate noise", "at most", 35.0),
        ("data", "rate noise, scale and lag estimated", "shown", 0.0),
    )
    for tuning, claim, sense, reach in marks:
        noise = batch.rate_noise_dps(tuning)
        found = (np.mean(noise), np.max(noise), np.mean(batch.float64_rate_noise_dps(tuning)))
        mean, worst, ideal = (100.0 * float(value) / sampled for value in found)
        yield Figure(claim, "white", tuning, GYROS, sense, reach, mean, worst, ideal)
    yield from honest_rows(batch, "white")
    mark = batch.lag_undone()
    for tuning in ("data", "known"):
        share = batch.integers(tuning).share_of(mark)
        yield Figure("angle, mean, against lag undone", "white", tuning, "% of it", "shown", 0.0, share[0])


def preset_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The patent's figures with a gyro without lag; the warm-up."""
    untrimmed = Batch.of("untrimmed", seeds)
    yield from share_rows("no lag to undo", untrimmed, "untrimmed", "untrimmed", "at most", PATENT_SHARE, source=True)
    yield from honest_rows(untrimmed, "untrimmed", lags=False, sense="compared")
    warm = Batch.of("warm_up", seeds)
    yield from share_rows("110 s with warm-up drift", warm, "warm_up", "warm_up", "shown", (0.0, 0.0))
    yield from honest_rows(warm, "warm_up")


def loss_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """Five seconds without one of the sensors, during the motion: residuals in degrees."""
    for sensor in ("angular", "gyro"):
        outage = (turntable.Outage("lost", sensor, 15.0, 20.0),)
        lossy = Batch(tuple(turntable.scenario("motion", seed, faults=outage) for seed in seeds))
        alone = float(np.mean(lossy.gyro.maximum)) if sensor == "angular" else None
        for tuning in ("data", "attitude"):
            worst = lossy.integers(tuning).maximum
            yield Figure(
                f"{sensor} sensor lost for 5 s, max", "motion", tuning, "deg", "shown", 0.0, float(np.mean(worst)),
                float(np.max(worst)), gyro_only=alone,
            )  # fmt: skip


def axis_rows(seeds: Iterable[int]) -> Iterator[Figure]:
    """The patent's table: mean and maximum residual about every axis, in degrees, with the gyro's."""
    batch = Batch.of("motion", seeds)
    alone = [turntable_gyro.residuals_deg(run) for run in batch.runs]
    for tuning in ("data", "attitude"):
        found = [residuals(run, attitude(batch.words(tuning, run))) for run in batch.runs]
        for i, axis in enumerate("xyz"):
            for kind, of in (("mean", np.mean), ("max", np.max)):
                ours, gyro = ([float(of(np.abs(run[:, i]))) for run in many] for many in (found, alone))
                yield Figure(
                    f"residual about {axis}, {kind}", "motion", tuning, "deg", "shown", 0.0, float(np.mean(ours)),
                    max(ours), gyro_only=float(np.mean(gyro)),
                )  # fmt: skip


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "many": many_rows,
    "motion": motion_rows,
    "beliefs": belief_rows,
    "rule": rule_rows,
    "axes": axis_rows,
    "lag": lag_rows,
    "white": white_rows,
    "presets": preset_rows,
    "loss": loss_rows,
}


def residual_plots(name: str = "motion", tuning: str = "data", seed: int = 1000) -> list[Plot]:
    """The patent's comparison: residuals of the gyro alone, with its lag undone where it has one, and of fusion."""
    batch = Batch.of(name, [seed])
    run = batch.runs[0]
    shown = np.flatnonzero(run.gyro_s >= REST_S)[::3]
    fused = residuals(run, attitude(batch.words(tuning, run)))
    at = np.searchsorted(run.time_s[run.scored], run.gyro_s[shown]).clip(0, len(fused) - 1)
    first = np.flatnonzero(run.gyro_s >= REST_S)[0]
    lines = [("gyro alone", turntable_gyro.residuals_deg(run)[shown - first], SENSOR)]
    if turntable.ERRORS[name].lag_s:
        undone = turntable_gyro.residuals_deg(run, lag_s=turntable.ERRORS[name].lag_s)
        lines.append(("gyro alone, lag undone", undone[shown - first], SECOND))
    lines.append(("data layer", fused[at], ESTIMATE))
    return [
        Plot(
            f"Residual about {axis}",
            "deg",
            run.gyro_s[shown],
            [Line(label, values[:, i], colour) for label, values, colour in lines],
        )
        for i, axis in enumerate("xyz")
    ]


def loss_plots(seed: int = 1000) -> list[Plot]:
    """Five seconds without one of the sensors: length of the residual."""
    panels = []
    for sensor, title in (("angular", "Angular accelerometer lost"), ("gyro", "Gyro lost")):
        outage = (turntable.Outage("lost", sensor, 15.0, 20.0),)
        batch = Batch((turntable.scenario("motion", seed, faults=outage),))
        run = batch.runs[0]
        lines = []
        for tuning, colour in (("data", ESTIMATE), ("attitude", SECOND)):
            length = np.linalg.norm(residuals(run, attitude(batch.words(tuning, run))), axis=1)
            lines.append(Line(f"{tuning} layer", np.asarray(length[::6], np.float64), colour))
        panels.append(Plot(f"{title} from 15 to 20 s: residual", "deg", run.time_s[run.scored][::6], lines))
    return panels


def spread_plot(seeds: Iterable[int] = range(1000, 1000 + TOGETHER)) -> XyPlot:
    """The residual compared with that of the gyro alone, run by run: each run has drawn scales of its own."""
    batch = Batch.of("motion", seeds)
    share = 100.0 * (np.arange(len(batch.runs)) + 0.5) / len(batch.runs)
    curves = []
    for label, found, colour in (
        ("data layer", batch.integers("data"), ESTIMATE),
        ("gyro alone, lag undone", batch.lag_undone(), SECOND),
    ):
        residual = np.sort(100.0 * found.mean / batch.gyro.mean)
        curves.append(Curve(label, share, residual, colour, points=True))
    asked = np.array([PATENT_SHARE[0], PATENT_SHARE[0]])
    curves.append(Curve("the patent's claim", np.array([0.0, 100.0]), asked, SENSOR, dashed=True))
    return XyPlot(
        f"Mean residual, in % of that of the gyro alone, {len(batch.runs)} runs",
        Axis("share of the runs (%)", low=0.0, high=100.0),
        Axis("of the gyro's residual (%)"),
        curves,
    )


PLOTS: dict[str, Callable[[], list[Plot] | XyPlot]] = {
    "residuals": residual_plots,
    "spread": spread_plot,
    "untrimmed": lambda: residual_plots("untrimmed", "untrimmed"),
    "loss": loss_plots,
}

"""Errors of every algorithm on every recording and input."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.contenders import Contender, Described
from plumb.analyses.comparison.grades import GRADES
from plumb.analyses.comparison.samples import Estimate, Motion, Samples, error_deg
from plumb.errors import UsageError

FloatArray = npt.NDArray[np.float64]
SIGMAS = 3.0
"""Errors beyond so many of an algorithm's own standard deviations are counted."""


@dataclass(frozen=True)
class Trial:
    """Input of an algorithm. recording: of which, or which motion; pieces: runs of their own, scored together."""

    recording: str
    seed: int
    pieces: tuple[Samples, ...]


@dataclass(frozen=True)
class Input:
    """A row of the table.

    name: what --json calls it; grade: of the sensors, with which decimate samples in a block; trials: makes its runs,
    count of them; bias_dps: bias of the gyro's axes that it adds.
    """

    name: str
    title: str
    grade: str
    decimate: int
    trials: Callable[[], Iterable[Trial]]
    count: int
    bias_dps: float = 0.0

    def outside(self, algorithms: Sequence[Described]) -> dict[str, str]:
        """Algorithm -> why this input lies outside what it can learn."""
        found = {}
        for one in algorithms:
            if one.bias_limit_dps is not None and self.bias_dps > one.bias_limit_dps:
                limit = f"a limit of {one.bias_limit_dps:g} deg/s" if one.bias_limit_dps else "no estimate"
                found[one.name] = f"{one.name} has {limit} of the gyro's bias, which is {self.bias_dps:g} deg/s an axis"
        return found


def of_recordings(motions: Sequence[Motion], grade: str, decimate: int) -> Input:
    """The recordings as a sensor of this grade feels them, at the rate that is lower by so many."""
    what = GRADES[grade]

    def trials() -> Iterable[Trial]:
        for motion in motions:
            for seed in what.seeds:
                pieces = what.samples(motion, seed, decimate)
                if not any(piece.scored.any() for piece in pieces):
                    raise UsageError(f"{motion.name}: no block of {decimate} samples is left to be scored")
                yield Trial(motion.name, seed, pieces)

    name = grade if decimate == 1 else f"{grade}/{decimate}"
    title = what.title + {1: "", 3: ", a third of the rate", 6: ", a sixth of the rate"}[decimate]
    return Input(name, title, grade, decimate, trials, len(motions) * len(what.seeds), what.bias_dps)


@dataclass(frozen=True)
class Row:
    """An algorithm on one recording, one input and one seed, deg: root mean square, largest and 95 % of the errors.
    sigma_deg: mean of the standard deviation that it states; beyond_3_sigma: share of the errors beyond three of it;
    None of an algorithm that states none."""

    algorithm: str
    recording: str
    seed: int
    rmse_deg: float
    max_deg: float
    p95_deg: float
    sigma_deg: float | None
    beyond_3_sigma: float | None


@dataclass(frozen=True)
class Means:
    """Figures of an algorithm over the recordings and seeds of an input: plain means, the worst root mean square and
    the largest error."""

    rmse_deg: float
    worst_rmse_deg: float
    p95_deg: float
    max_deg: float
    sigma_deg: float | None
    beyond_3_sigma: float | None


@dataclass(frozen=True)
class Trace:
    """Error over time of one recording, for plots: errors_deg by the name of the algorithm, (N,)."""

    recording: str
    time_s: FloatArray
    errors_deg: dict[str, FloatArray]


@dataclass(frozen=True)
class Flown:
    """How an algorithm's flights ended: crashed, and begun again by the estimator, of so many."""

    algorithm: str
    crashes: int
    restarts: int
    flights: int


@dataclass(frozen=True)
class Compared:
    """Rows of one input. traces: of the first input alone. flown: of a flight, one of every algorithm."""

    input: Input
    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]
    flown: tuple[Flown, ...] = ()

    def means(self, algorithm: str) -> Means | None:
        """None for an algorithm that cannot have the period of one of the recordings."""
        own = [row for row in self.rows if row.algorithm == algorithm]
        counts = [sum(row.algorithm == name for row in self.rows) for name in {row.algorithm for row in self.rows}]
        if not own or (len(own) < max(counts) and not self.flown):
            return None
        sigma = [row.sigma_deg for row in own if row.sigma_deg is not None]
        beyond = [row.beyond_3_sigma for row in own if row.beyond_3_sigma is not None]
        return Means(
            rmse_deg=float(np.mean([row.rmse_deg for row in own])),
            worst_rmse_deg=max(row.rmse_deg for row in own),
            p95_deg=float(np.mean([row.p95_deg for row in own])),
            max_deg=max(row.max_deg for row in own),
            sigma_deg=float(np.mean(sigma)) if sigma else None,
            beyond_3_sigma=float(np.mean(beyond)) if beyond else None,
        )


def compare(inputs: Sequence[Input], algorithms: Sequence[Contender], done: Callable[[], object]) -> list[Compared]:
    """Run all of them. done: called after every run of an algorithm. Raises UsageError, with the name of algorithm and
    recording, for an estimate that is no number."""
    return [_compare(one, algorithms, done, traced=one is inputs[0]) for one in inputs]


def runs(inputs: Sequence[Input], algorithms: Sequence[Contender]) -> int:
    """How often `compare` calls `done`."""
    return len(algorithms) * sum(one.count for one in inputs)


def row_of(algorithm: str, recording: str, seed: int, error: FloatArray, sigma_deg: FloatArray | None) -> Row:
    """From the scored errors, (N,), and the standard deviations that the algorithm states for them."""
    mean = beyond = None
    if sigma_deg is not None:
        mean, beyond = float(np.mean(sigma_deg)), float(np.mean(error > SIGMAS * sigma_deg))
    rmse_deg, p95_deg = float(np.sqrt(np.mean(error**2))), float(np.percentile(error, 95))
    return Row(algorithm, recording, seed, rmse_deg, float(np.max(error)), p95_deg, mean, beyond)


def _estimates(algorithm: Contender, pieces: Sequence[Samples]) -> list[Estimate] | None:
    """None for a system that cannot have the period of these samples: a published algorithm takes any."""
    try:
        return [algorithm.estimate(one) for one in pieces]
    except UsageError:
        return None


def _compare(what: Input, algorithms: Sequence[Contender], done: Callable[[], object], *, traced: bool) -> Compared:
    rows: list[Row] = []
    traces: list[Trace] = []
    for trial in what.trials():
        errors = {}
        for algorithm in algorithms:
            estimates = _estimates(algorithm, trial.pieces)
            done()
            if estimates is None:
                continue
            both = list(zip(trial.pieces, estimates, strict=True))
            each = [error_deg(estimate.up, piece.up) for piece, estimate in both]
            scored = np.concatenate([error[piece.scored] for error, piece in zip(each, trial.pieces, strict=True)])
            if not np.isfinite(scored).all():
                raise UsageError(f"{algorithm.name} has no estimate for samples of {trial.recording}")
            stated = [one.sigma_deg[piece.scored] for piece, one in both if one.sigma_deg is not None]
            sigma_deg = np.concatenate(stated) if stated else None
            rows.append(row_of(algorithm.name, trial.recording, trial.seed, scored, sigma_deg))
            errors[algorithm.name] = np.where(trial.pieces[0].scored, each[0], np.nan)
        if traced and trial.recording not in {one.recording for one in traces}:
            traces.append(Trace(trial.recording, trial.pieces[0].time_s, errors))
    return Compared(what, tuple(rows), tuple(traces))

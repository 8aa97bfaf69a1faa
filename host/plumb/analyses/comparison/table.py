"""Errors of every algorithm on every recording and input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.contenders import Contender
from plumb.analyses.comparison.grades import GRADES
from plumb.analyses.comparison.samples import Motion, Samples, error_deg, sampled
from plumb.errors import UsageError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Input:
    """What is made of a recording. decimate: samples in a block; grade: a name of GRADES."""

    decimate: int
    grade: str

    @property
    def title(self) -> str:
        rate = {1: "", 3: ", a third of the rate", 6: ", a sixth of the rate"}[self.decimate]
        return GRADES[self.grade].title + rate


@dataclass(frozen=True)
class Row:
    """An algorithm on one recording, one input and one seed, deg: root mean square, largest and 95 % of the errors."""

    algorithm: str
    recording: str
    seed: int
    rmse_deg: float
    max_deg: float
    p95_deg: float


@dataclass(frozen=True)
class Trace:
    """Error over time of one recording, for plots: errors_deg by the name of the algorithm, (N,)."""

    recording: str
    time_s: FloatArray
    errors_deg: dict[str, FloatArray]


@dataclass(frozen=True)
class Compared:
    """Rows of one input. traces: of the first input alone."""

    input: Input
    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]

    def mean_deg(self, algorithm: str) -> tuple[float, float, float] | None:
        """Plain means over recordings and seeds of the root mean square and of the 95 %, and the largest error; None
        for an algorithm that cannot have the period of one of them."""
        own = [row for row in self.rows if row.algorithm == algorithm]
        if len(own) < max(
            sum(row.algorithm == name for row in self.rows) for name in {row.algorithm for row in self.rows}
        ):
            return None
        rmse, p95 = (float(np.mean([getattr(row, name) for row in own])) for name in ("rmse_deg", "p95_deg"))
        return rmse, p95, max(row.max_deg for row in own)


def compare(
    motions: Sequence[Motion],
    inputs: Sequence[Input],
    algorithms: Sequence[Contender],
    done: Callable[[], object],
) -> list[Compared]:
    """Run all of them. done: called after every run of an algorithm. Raises UsageError, with the name of algorithm and
    recording, for an estimate that is no number."""
    return [_compare(motions, one, algorithms, done, traced=one is inputs[0]) for one in inputs]


def runs(motions: Sequence[Motion], inputs: Sequence[Input], algorithms: Sequence[Contender]) -> int:
    """How often `compare` calls `done`."""
    return len(motions) * len(algorithms) * sum(len(GRADES[one.grade].seeds) for one in inputs)


def _verticals(algorithm: Contender, samples: Samples) -> FloatArray | None:
    """None for a system that cannot have the period of these samples: a published algorithm takes any."""
    try:
        return algorithm.verticals(samples)
    except UsageError:
        return None


def _compare(
    motions: Sequence[Motion], what: Input, algorithms: Sequence[Contender], done: Callable[[], object], *, traced: bool
) -> Compared:
    rows: list[Row] = []
    traces: list[Trace] = []
    grade = GRADES[what.grade]
    for motion in motions:
        for seed in grade.seeds:
            samples = sampled(grade.of(motion, seed), grade.sensor, what.decimate)
            if not samples.scored.any():
                raise UsageError(f"{motion.name}: no block of {what.decimate} samples is left to be scored")
            errors = {}
            for algorithm in algorithms:
                verticals = _verticals(algorithm, samples)
                done()
                if verticals is None:
                    continue
                error = error_deg(verticals, samples.up)
                counted = error[samples.scored]
                if not np.isfinite(counted).all():
                    raise UsageError(f"{algorithm.name} has no estimate for samples of {motion.name}")
                rmse_deg, p95_deg = float(np.sqrt(np.mean(counted**2))), float(np.percentile(counted, 95))
                row = Row(algorithm.name, motion.name, seed, rmse_deg, float(np.max(counted)), p95_deg)
                rows.append(row)
                errors[algorithm.name] = np.where(samples.scored, error, np.nan)
            if traced and seed == grade.seeds[0]:
                traces.append(Trace(motion.name, samples.time_s, errors))
    return Compared(what, tuple(rows), tuple(traces))

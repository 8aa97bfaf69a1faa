"""Figures of a campaign: means with intervals, quantiles, the worst seeds, and which factor moves a figure.

An interval is that of the mean: it has the true mean of all seeds in 95 % of campaigns (bootstrap, percentiles).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from plumb.campaign.results import Results
from plumb.errors import UsageError
from plumb.near_names import did_you_mean
from plumb.proof import intervals
from plumb.spec.arrays import FloatArray

NORMAL_95 = 1.959964
BINS = 8
"""Equal parts of a range, whose means show what the factor does."""
WORST = 10


@dataclass(frozen=True)
class Figure:
    """runs: those that have the figure. low, high: the 95 % interval of the mean. worst_index: of the run with the
    largest value."""

    mean: float
    low: float
    high: float
    runs: int
    sd: float
    min: float
    p05: float
    median: float
    p95: float
    max: float
    worst_index: int

    def to_json(self) -> dict[str, float | int]:
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.mean:.4g} ({self.low:.4g} to {self.high:.4g})"


def figure(values: FloatArray, index: np.ndarray[Any, np.dtype[np.int64]]) -> Figure | None:  # Any: of any shape
    """The figure of a metric, values (runs,) with NaN where a run has none; None where no run has one."""
    known = np.isfinite(values)
    if not known.any():
        return None
    kept = values[known]
    low, high = intervals.of_mean(kept)
    p05, median, p95 = (float(one) for one in np.percentile(kept, [5, 50, 95]))
    worst = int(index[known][np.argmax(kept)])
    spread = float(np.std(kept, ddof=1)) if len(kept) > 1 else 0.0
    return Figure(
        float(np.mean(kept)),
        low,
        high,
        len(kept),
        spread,
        float(kept.min()),
        p05,
        median,
        p95,
        float(kept.max()),
        worst,
    )


def figures(results: Results) -> dict[str, Figure]:
    """Every metric that at least one run has, by name."""
    found = {name: figure(values, results.index) for name, values in results.metrics.items()}
    return {name: one for name, one in found.items() if one is not None}


def worst(results: Results, metric: str) -> list[tuple[int, int, float]]:
    """Index, seed and value of the runs with the largest values of a metric."""
    values = results.metrics[metric]
    order = np.argsort(np.where(np.isfinite(values), -values, np.inf), kind="stable")[:WORST]
    return [
        (int(results.index[place]), int(results.seed[place]), float(values[place]))
        for place in order
        if np.isfinite(values[place])
    ]


@dataclass(frozen=True)
class Point:
    """The runs of one combination of the factors. values: of the factors, by name, as texts."""

    values: Mapping[str, str]
    figures: Mapping[str, Figure]

    def to_json(self) -> dict[str, object]:
        return {"values": dict(self.values), "metrics": to_json(self.figures)}


def points(results: Results) -> list[Point]:
    """Every combination of the factors that runs have, in the order of its first run."""
    texts = {name: [_text(one) for one in column] for name, column in results.values.items()}
    places: dict[tuple[str, ...], list[int]] = {}
    for place, combination in enumerate(zip(*texts.values(), strict=True)):
        places.setdefault(combination, []).append(place)
    found = []
    for combination, of in places.items():
        each = {name: figure(values[of], results.index[of]) for name, values in results.metrics.items()}
        known = {name: one for name, one in each.items() if one is not None}
        found.append(Point(dict(zip(texts, combination, strict=True)), known))
    return found


@dataclass(frozen=True)
class Share:
    """Part of the runs that keep the limit of a metric. low, high: 95 % interval of the part of all seeds (Wilson)."""

    metric: str
    limit: float
    kept: int
    runs: int
    low: float
    high: float

    def to_json(self) -> dict[str, object]:
        return {**asdict(self), "share": self.kept / self.runs}

    def __str__(self) -> str:
        return (
            f"{100.0 * self.kept / self.runs:.1f} % of the runs have {self.metric} of at most {self.limit:g} "
            f"({100.0 * self.low:.1f} to {100.0 * self.high:.1f} %)"
        )


def check_limits(limits: Mapping[str, float], metrics: Collection[str]) -> None:
    """Raises UsageError for a limit of a metric that no run has."""
    for metric in limits:
        if metric not in metrics:
            near = did_you_mean(metric, list(metrics))
            raise UsageError(f"limits.{metric}: no run has it{near}; there are {', '.join(metrics) or 'no metrics'}")


def shares(results: Results, limits: Mapping[str, float]) -> list[Share]:
    """Results of every limit; a run without the figure, or that failed, does not keep it. Raises UsageError for a
    metric that no run has."""
    check_limits(limits, results.metrics)
    found = []
    for metric, limit in limits.items():
        kept, runs = int(np.count_nonzero(results.metrics[metric] <= limit)), len(results)
        part, square = kept / runs, NORMAL_95**2
        centre = (part + square / (2.0 * runs)) / (1.0 + square / runs)
        half = NORMAL_95 * math.sqrt(part * (1.0 - part) / runs + square / (4.0 * runs**2)) / (1.0 + square / runs)
        found.append(Share(metric, limit, kept, runs, max(0.0, centre - half), min(1.0, centre + half)))
    return found


@dataclass(frozen=True)
class Effect:
    """Effect of a factor on a metric. share: of the metric's variance that the levels explain, 0 to 1 (the correlation
    ratio, corrected for what chance explains). levels: name, mean of the metric and number of runs."""

    factor: str
    metric: str
    share: float
    levels: tuple[tuple[str, float, int], ...]


def effect(factor: str, metric: str, settings: Sequence[Any], values: FloatArray) -> Effect | None:  # Any: of any shape
    """None where the factor has one level only."""
    level_of, names = _levels(settings)
    known = np.isfinite(values)
    kept, of = values[known], level_of[known]
    groups = [(names[level], kept[of == level]) for level in range(len(names)) if (of == level).any()]
    total = float(np.sum((kept - kept.mean()) ** 2)) if len(kept) else 0.0
    if len(groups) < 2 or len(kept) <= len(groups) or total == 0.0:
        return None
    within = sum(float(np.sum((group - group.mean()) ** 2)) for _, group in groups)
    share = 1.0 - (within / (len(kept) - len(groups))) / (total / (len(kept) - 1))
    levels = tuple((name, float(group.mean()), len(group)) for name, group in groups)
    return Effect(factor, metric, max(0.0, share), levels)


def _levels(settings: Sequence[Any]) -> tuple[np.ndarray[Any, np.dtype[np.int64]], list[str]]:  # Any: of any shape
    """Level of every run, and the levels' names: values, or equal parts of many numbers."""
    if all(isinstance(one, int | float) for one in settings) and len(set(settings)) > BINS:
        numbers = np.array(settings, np.float64)
        edges = np.quantile(numbers, np.linspace(0.0, 1.0, BINS + 1))
        level = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, BINS - 1)
        return level.astype(np.int64), [f"{a:.3g} to {b:.3g}" for a, b in itertools.pairwise(edges)]
    texts = [_text(one) for one in settings]
    names = list(dict.fromkeys(texts))
    places = {name: place for place, name in enumerate(names)}
    return np.array([places[text] for text in texts], np.int64), names


def _text(value: Any) -> str:  # Any: of any type that a factor may have
    if isinstance(value, list):
        return ", ".join(value) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def effects(results: Results, metrics: Sequence[str]) -> list[Effect]:
    """Every factor on every metric, the largest share first."""
    found = [
        one
        for metric in metrics
        for factor, settings in results.values.items()
        if (one := effect(factor, metric, settings, results.metrics[metric])) is not None
    ]
    return sorted(found, key=lambda one: -one.share)


def to_json(found: Mapping[str, Figure]) -> dict[str, dict[str, float | int]]:
    return {name: one.to_json() for name, one in found.items()}

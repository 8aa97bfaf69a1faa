"""Flights as rows of the comparison: the same tables, page and JSON as recordings have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from plumb.analyses.comparison.table import Compared, Flown, Input, Row, Trace, row_of
from plumb.analyses.flights.estimators import Estimator
from plumb.analyses.flights.flights import EXTRA, FLIGHTS
from plumb.analyses.flights.fly import Flew, fly
from plumb.errors import UsageError

FIRST_SEED, SEEDS = 1000, 4
GRADE = "flight"


def chosen(only: Sequence[str]) -> list[str]:
    """Names of flights in the order of the table; only: () for all that do not take long."""
    for name in only:
        if name not in FLIGHTS:
            raise UsageError(f"there is no flight '{name}'; there are {', '.join(FLIGHTS)}")
    return [name for name in FLIGHTS if (name in only if only else name not in EXTRA)]


def seconds(names: Sequence[str]) -> float:
    """Simulated time of one seed of these flights."""
    return sum(FLIGHTS[name].seconds for name in names)


def flown(
    name: str,
    seeds: Sequence[int],
    estimators: Sequence[Estimator],
    done: Callable[[float], object],
    drag_setting_per_s: float | None = None,
) -> Compared:
    """One flight by all estimators. done: called with the seconds that were flown since the last call;
    drag_setting_per_s: set in estimators that use the drag; None: that of the airframe."""
    flight = FLIGHTS[name]
    if drag_setting_per_s is not None:
        flight = replace(flight, frame=replace(flight.frame, drag_setting_per_s=drag_setting_per_s))
    what = Input(name, flight.title, GRADE, 1, lambda: (), len(seeds), flight.grade.bias_dps)
    flights = fly(flight, seeds, estimators, done)
    rows = [row for at, seed in enumerate(seeds) for one in flights if (row := _row(name, one, at, seed)) is not None]
    errors = {one.estimator: one.errors_deg[:, 0] for one in flights}
    notes = tuple(Flown(one.estimator, int(one.crashed.sum()), one.restarts, len(seeds)) for one in flights)
    return Compared(what, tuple(rows), (Trace(f"{name}, seed {seeds[0]}", flights[0].time_s, errors),), notes)


def _row(name: str, one: Flew, at: int, seed: int) -> Row | None:
    """None of a run that crashed before anything was scored."""
    errors = one.errors_deg[:, at]
    scored = np.isfinite(errors)
    if not scored.any():
        return None
    sigma_deg = None if one.sigma_deg is None else one.sigma_deg[scored, at]
    return row_of(one.estimator, name, seed, errors[scored], sigma_deg)

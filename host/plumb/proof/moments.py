"""Moments of a run in the order of its steps: what lasts behind an event, and runs laid upon each other by theirs."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import BoolArray, FloatArray


def behind(on: BoolArray, steps: int) -> BoolArray:
    """(steps of the run,): True where it is or was true at most so many steps ago."""
    places = np.arange(len(on))
    last = np.maximum.accumulate(np.where(on, places, -steps - 1))
    return np.asarray(places - last <= steps)


def around(
    values: FloatArray, time_s: FloatArray, begin_s: FloatArray, end_s: FloatArray | float = np.inf
) -> FloatArray:
    """The rows of each run from its own begin_s up to its own end_s, (runs,) each; as many of all runs as the shortest
    has. values: (steps, .., runs); time_s: (steps,)."""
    firsts = np.searchsorted(time_s, begin_s - 1e-9)
    lasts = np.searchsorted(time_s, np.broadcast_to(np.asarray(end_s) - 1e-9, begin_s.shape))
    rows = int(np.min(lasts - firsts))
    return np.stack([values[first : first + rows, ..., run] for run, first in enumerate(firsts)], -1)

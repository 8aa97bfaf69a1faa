"""Samples on an even grid, for comparisons over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit.samples import Samples
from plumb.readers.recording import steady
from plumb.spec.arrays import BoolArray, FloatArray

LEAST_STEP_S, MOST_STEP_S = 0.004, 0.1
GAP_STEPS = 4.0


@dataclass(frozen=True)
class Grid:
    """time_s (n,) from 0; gyr_dps, acc_g (n, 3); usable (n,): no gap and no marked sample is near; step_s."""

    time_s: FloatArray
    gyr_dps: FloatArray
    acc_g: FloatArray
    usable: BoolArray
    step_s: float


def grid_of(samples: Samples, marked: BoolArray) -> Grid | None:
    """Of samples in order of time; marked (N,): samples that say nothing. None where the step is none of a sensor's."""
    step_s = max(samples.step_s, LEAST_STEP_S)
    if not step_s <= MOST_STEP_S:
        return None
    period_us = round(step_s * 1e6)
    time_s = samples.time_s - samples.time_s[0]
    values = steady(time_s, np.hstack([samples.gyr_dps, samples.acc_g]), period_us)
    at_s = np.arange(len(values), dtype=np.float64) * (period_us * 1e-6)
    wide = np.flatnonzero(np.diff(time_s) > GAP_STEPS * step_s)
    usable = np.ones(len(values), np.bool_)
    for first, last in [(time_s[at], time_s[at + 1]) for at in wide[:1000]]:
        usable[(at_s >= first) & (at_s <= last)] = False
    near = np.clip(np.rint(time_s[marked] / (period_us * 1e-6)).astype(int), 0, len(values) - 1)
    usable[near] = False
    return Grid(at_s, values[:, :3], values[:, 3:], usable, period_us * 1e-6)

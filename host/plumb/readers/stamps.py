"""Time stamps that several rows share, and rows that come twice."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import BoolArray, FloatArray


def repeats(time_s: FloatArray, gyr: FloatArray, acc: FloatArray) -> BoolArray:
    """Rows whose stamp and samples are those of the row before, (N,). time_s (N,); gyr, acc (N, 3)."""
    table = np.column_stack([time_s, gyr, acc])
    return np.concatenate([[False], np.all(np.diff(table, axis=0) == 0.0, axis=1)])


def spread(time_s: FloatArray) -> FloatArray:
    """Each run of equal stamps spread until the next stamp; the last run by the step of the others."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(time_s) != 0.0]))
    sizes = np.diff(np.append(first, len(time_s)))
    stamps = time_s[first]
    steps = np.diff(stamps)
    usual = float(np.median(steps[steps > 0.0] / sizes[:-1][steps > 0.0])) if np.any(steps > 0.0) else 1.0
    # A gap after a run is no reason to spread the run over it.
    own = np.minimum(np.append(steps, usual * sizes[-1]) / sizes, 2.0 * usual)
    own = np.where(own > 0.0, own, usual)
    inside = np.arange(len(time_s)) - np.repeat(first, sizes)
    return np.asarray(np.repeat(stamps, sizes) + inside * np.repeat(own, sizes), np.float64)

"""95 % intervals of means over runs, by resampling the runs (bootstrap, percentiles)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import FloatArray

RESAMPLES = 2000
BLOCKS = 10_000
"""Most values that a resampling draws from; more runs are first averaged in groups of equal size."""
AT_ONCE = 100_000
"""Values that are drawn at once: for the few runs of a figure all resamples, and never much memory."""
LOW, HIGH = 2.5, 97.5


def of_mean(values: FloatArray) -> tuple[float, float]:
    """The interval of the mean, values (runs,). It has its own random generator: the same values give the same
    interval."""
    blocks = values
    if len(values) > BLOCKS:
        whole = len(values) // BLOCKS * BLOCKS
        blocks = values[:whole].reshape(BLOCKS, -1).mean(axis=1)
    means = np.concatenate([blocks[drawn].mean(axis=1) for drawn in _drawn(len(values), len(blocks))])
    low, high = np.percentile(means, [LOW, HIGH])
    return float(low), float(high)


def share(found: FloatArray, mark: FloatArray) -> tuple[float, float]:
    """The interval of 100 % mean(found) / mean(mark), both (runs,) of the same runs, which are drawn in pairs."""
    shares = [100.0 * found[drawn].mean(axis=1) / mark[drawn].mean(axis=1) for drawn in _drawn(len(found), len(found))]
    low, high = np.percentile(np.concatenate(shares), [LOW, HIGH])
    return float(low), float(high)


def _drawn(seed: int, count: int) -> Iterator[npt.NDArray[np.int64]]:
    """RESAMPLES rows of `count` indices below it, some rows at a time: the same ones as row by row."""
    rng, rows = np.random.default_rng(seed), max(AT_ONCE // count, 1)
    for begin in range(0, RESAMPLES, rows):
        yield rng.integers(0, count, (min(rows, RESAMPLES - begin), count))

"""95 % intervals of means over runs, by resampling the runs (bootstrap, percentiles)."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray

RESAMPLES = 2000
BLOCKS = 10_000
"""Most values that a resampling draws from; more runs are first averaged in groups of equal size."""
LOW, HIGH = 2.5, 97.5


def of_mean(values: FloatArray) -> tuple[float, float]:
    """The interval of the mean, values (runs,). It has its own random generator: the same values give the same
    interval."""
    blocks = values
    if len(values) > BLOCKS:
        whole = len(values) // BLOCKS * BLOCKS
        blocks = values[:whole].reshape(BLOCKS, -1).mean(axis=1)
    rng = np.random.default_rng(len(values))
    means = np.empty(RESAMPLES)
    for at in range(RESAMPLES):
        means[at] = blocks[rng.integers(0, len(blocks), len(blocks))].mean()
    low, high = np.percentile(means, [LOW, HIGH])
    return float(low), float(high)


def share(found: FloatArray, mark: FloatArray) -> tuple[float, float]:
    """The interval of 100 % mean(found) / mean(mark), both (runs,) of the same runs, which are drawn in pairs."""
    rng = np.random.default_rng(len(found))
    shares = np.empty(RESAMPLES)
    for at in range(RESAMPLES):
        drawn = rng.integers(0, len(found), len(found))
        shares[at] = 100.0 * found[drawn].mean() / mark[drawn].mean()
    low, high = np.percentile(shares, [LOW, HIGH])
    return float(low), float(high)

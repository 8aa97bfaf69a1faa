"""Overlapping Allan deviation of a signal at rest, with its confidence.

Of n values at a constant period, the Allan variance at the averaging time tau = m periods is half the mean square of
the difference of neighbouring means over m values, at every place where two of them fit (NIST SP 1065, 5.2.4). The
places overlap, so their number overstates what is known; the equivalent degrees of freedom of the three noises (SP
1065, 5.4.2) give the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray

POINTS_PER_DECADE = 10
LONGEST_SHARE = 1 / 3
"""Longest averaging time, of the length of the signal: beyond it a handful of differences decides."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class AllanDeviation:
    """tau_s, deviation, low, high: (points,); deviation in the unit of the signal; low and high: 95 % interval."""

    tau_s: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray


def block_sizes(samples: int) -> list[int]:
    """Averaging times in samples, about evenly spaced on a logarithmic axis."""
    longest = max(1, int(samples * LONGEST_SHARE))
    count = 1 + int(np.ceil(POINTS_PER_DECADE * np.log10(longest))) if longest > 1 else 1
    return sorted({round(float(m)) for m in np.geomspace(1.0, longest, count)})


def variances(values: FloatArray, sizes: Sequence[int]) -> FloatArray:
    """The overlapping Allan variance at each size, (sizes,). values: (n,), n at least twice the largest size."""
    centred = values - values[0]  # keeps the sums small: the variance of a difference does not depend on it
    sums = np.concatenate([[0.0], np.cumsum(centred)])
    found = []
    for m in sizes:
        second = sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]
        found.append(float(np.mean(second * second)) / (2.0 * m * m))
    return np.array(found)


def degrees_of_freedom(noise: str, samples: int, m: int) -> float:
    """Equivalent degrees of freedom of an overlapping Allan variance. noise: white, flicker or walk, of the signal;
    samples: its values. Never less than 1."""
    n = samples + 1  # SP 1065 counts values of the integral
    match noise:
        case "white":
            found = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m * m / (4 * m * m + 5)
        case "flicker":
            found = 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n * n / (4 * m * (n + 3 * m))
        case "walk":
            found = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m * m) / (n - 3) ** 2
        case _:
            raise ValueError(f"there is no noise {noise!r}")
    return max(1.0, found)


def allan_deviation(values: FloatArray, period_s: float, noise_at: Callable[[float], str]) -> AllanDeviation:
    """The curve of a signal, (n,). noise_at: the noise that dominates at an averaging time in s."""
    from scipy.stats import chi2

    sizes = block_sizes(len(values))
    tau_s = np.array(sizes) * period_s
    variance = variances(values, sizes)
    freedom = np.array([degrees_of_freedom(noise_at(t), len(values), m) for t, m in zip(tau_s, sizes, strict=True)])
    tail = (1.0 - CONFIDENCE) / 2.0
    low = np.sqrt(variance * freedom / chi2.ppf(1.0 - tail, freedom))
    high = np.sqrt(variance * freedom / chi2.ppf(tail, freedom))
    return AllanDeviation(tau_s, np.sqrt(variance), np.asarray(low), np.asarray(high))

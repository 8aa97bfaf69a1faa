"""For how long a sensor may repeat its counts before it is stuck: from its least noise at rest, the smallest limit with
a false alarm in 10 000 hours.

The noise of a digital sensor makes equal counts now and then; the worst place of the mean between two codes is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

HOURS = 1e4
FASTEST_S = 0.010
"""Readings count as independent at least so far apart, whatever the bandwidth."""
SHORTEST = 3
"""The least limit of all axes together, in repeats."""
NEVER_US = 2_000_000_000
"""A limit beyond what the board counts (IMU_STILL_STOPS_US, 1000 s): noise so small that counts which stand still say
nothing."""
_PLACES = tuple(place / 40.0 for place in range(21))
"""Of the mean between two codes, in counts."""


@dataclass(frozen=True)
class Still:
    """interval_ms: readings closer than that depend on each other; whole, axis: so many repeats of all axes, of one
    axis that should have moved, are a stuck sensor."""

    interval_ms: int
    whole: int
    axis: int


@lru_cache(maxsize=256)
def _codes(sigma_counts: float) -> tuple[tuple[float, ...], ...]:
    """Chance of each code, for each place of the mean."""
    reach = math.ceil(8.0 * sigma_counts) + 2
    scale = sigma_counts * math.sqrt(2.0)
    found = []
    for place in _PLACES:
        edges = [math.erf((code - 0.5 - place) / scale) for code in range(-reach, reach + 2)]
        found.append(tuple(0.5 * (high - low) for low, high in pairwise(edges)))
    return tuple(found)


def _alike(sigma_counts: float, repeats: int) -> float:
    """Chance that a reading and so many after it are equal."""
    return max(math.fsum(chance ** (repeats + 1) for chance in place) for place in _codes(sigma_counts))


def _least(hours: Callable[[int], float], start: int, most: int) -> int:
    """The least number of repeats from `start` with a false alarm in HOURS or more; `most` where there is none."""
    if hours(most) < HOURS:
        return most
    low, high = start - 1, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if hours(middle) >= HOURS else (middle, high)
    return high


def limits(sigmas_counts: Sequence[float], independent_s: float) -> Still:
    """sigmas_counts: least noise at rest of each axis; independent_s: readings so far apart do not know of each
    other."""
    interval_ms = math.floor(max(FASTEST_S, independent_s) * 1000.0 + 0.5)
    step_h = interval_ms / 3.6e6
    most = min(NEVER_US // (1000 * interval_ms), 0xFFFF)

    def whole_hours(repeats: int) -> float:
        chance = math.prod(_alike(sigma, repeats) for sigma in sigmas_counts)
        return step_h / chance if chance else math.inf

    def axis_hours(repeats: int) -> float:
        chance = sum(_alike(sigma, repeats) for sigma in sigmas_counts)
        return step_h / chance if chance else math.inf

    return Still(interval_ms, _least(whole_hours, SHORTEST, most), _least(axis_hours, 1, most))

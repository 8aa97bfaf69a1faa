"""Latencies in buckets of equal relative width, so that a long run takes no more memory than a short one.

Each power of two of nanoseconds has STEPS buckets: a percentile is at most 1/STEPS above the true one. The largest
value is kept as it is.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TypedDict

STEPS_BITS = 5
STEPS = 1 << STEPS_BITS
PERCENTILES = (50, 95, 99)
BAR_COLUMNS = 40
LOWEST_ROW_MS = 0.001
_ROWS = (1.0, 2.0, 5.0)
"""Upper bounds of the rows of a drawn histogram, times powers of ten."""


class Percentiles(TypedDict):
    """A histogram for programs. buckets: [upper bound in ms, count] of the buckets that are not empty."""

    count: int
    p50_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float
    buckets: list[tuple[float, int]]


class LatencyHistogram:
    """Counts latencies. count, max_s: of all that were noted."""

    def __init__(self) -> None:
        self.count = 0
        self.max_s = 0.0
        self._buckets: Counter[int] = Counter()

    def note(self, latency_s: float, times: int = 1) -> None:
        """Count a latency; one below 0 counts as 0."""
        self.count += times
        self.max_s = max(self.max_s, latency_s)
        self._buckets[_bucket_of(max(0, round(latency_s * 1e9)))] += times

    def percentile_s(self, percent: float) -> float:
        """Upper bound of the bucket in which this share of the latencies ends; 0 without any."""
        wanted, seen = math.ceil(self.count * percent / 100 - 1e-9), 0
        for bucket, count in sorted(self._buckets.items()):
            seen += count
            if seen >= wanted:
                return min(self.max_s, _upper_ns(bucket) * 1e-9)
        return 0.0

    def as_dict(self) -> Percentiles:
        p50, p95, p99 = (round(1e3 * self.percentile_s(percent), 4) for percent in PERCENTILES)
        buckets = [(round(_upper_ns(bucket) * 1e-6, 6), count) for bucket, count in sorted(self._buckets.items())]
        return Percentiles(
            count=self.count, p50_ms=p50, p95_ms=p95, p99_ms=p99, max_ms=round(1e3 * self.max_s, 4), buckets=buckets
        )


def short(said: Percentiles) -> str:
    """Median and 99 % for a line that is printed again and again."""
    return f"{said['p50_ms']:.2f}/{said['p99_ms']:.2f} ms" if said["count"] else "-"


def drawn(said: Percentiles) -> list[str]:
    """The percentiles, and a bar for each range between 1, 2, 5 and their powers of ten, in ms."""
    if not said["count"]:
        return ["none"]
    rows: Counter[float] = Counter()
    for upper_ms, count in said["buckets"]:
        rows[_row_of(min(upper_ms, said["max_ms"]))] += count
    bounds = _bounds(min(rows), max(rows))
    most, wide = max(rows.values()), max(len(f"{bound:g}") for bound in bounds)
    head = (
        f"{said['count']} frames, median {said['p50_ms']:.3g} ms, 95 % within {said['p95_ms']:.3g}, "
        f"99 % within {said['p99_ms']:.3g}, all within {said['max_ms']:.3g}"
    )
    return [head] + [
        f"  to {bound:>{wide}g} ms |{'#' * math.ceil(BAR_COLUMNS * rows[bound] / most):<{BAR_COLUMNS}}| {rows[bound]}"
        for bound in bounds
    ]


def _bucket_of(value_ns: int) -> int:
    """Number of a bucket, growing with the value: values below 2 * STEPS have one each."""
    shift = max(0, value_ns.bit_length() - STEPS_BITS - 1)
    return (shift << STEPS_BITS) + (value_ns >> shift)


def _upper_ns(bucket: int) -> int:
    """The largest value of a bucket."""
    shift = max(0, (bucket >> STEPS_BITS) - 1)
    return ((bucket - (shift << STEPS_BITS) + 1) << shift) - 1


def _row_of(value_ms: float) -> float:
    """The smallest bound of a row that is not below the value."""
    value_ms = max(value_ms, LOWEST_ROW_MS)
    decade = 10.0 ** math.floor(math.log10(value_ms))
    return next(float(f"{decade * step:.0e}") for step in (*_ROWS, 10.0) if value_ms <= decade * step * (1 + 1e-9))


def _bounds(first: float, last: float) -> list[float]:
    """All bounds of rows from first to last."""
    found = [first]
    while found[-1] < last * (1 - 1e-9):
        digit = round(found[-1] / 10.0 ** math.floor(math.log10(found[-1]) + 1e-9))
        found.append(float(f"{found[-1] * (2.5 if digit == 2 else 2.0):.0e}"))
    return found

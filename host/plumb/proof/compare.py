"""Where two records of the same run part: the first step, the first signal in written order, and both values."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.spec.records import Words


@dataclass(frozen=True)
class Divergence:
    """The first word that differs. signal "steps" means that one record ended before the other."""

    step: int
    run: int
    signal: str
    expected: int | None
    actual: int | None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    def __str__(self) -> str:
        return f"step {self.step}, run {self.run}: {self.signal} is {self.actual}, expected {self.expected}"


def first_divergence(expected: Words, actual: Words) -> Divergence | None:
    """Lowest step, then lowest run, then first signal in written order; None when every bit agrees."""
    a, b = expected.record, actual.record
    if a.shape[1:] != b.shape[1:]:
        raise ValueError(f"records of {a.shape[1:]} and {b.shape[1:]} runs cannot be compared")
    steps = min(len(a), len(b))
    differs = a[:steps] != b[:steps]
    if differs.any():
        step, *run = (int(i) for i in np.argwhere(differs)[0])
        row_a, row_b = a[(step, *run)], b[(step, *run)]
        signal = next(name for name in expected.names if row_a[name] != row_b[name])
        return Divergence(step, run[0] if run else 0, signal, int(row_a[signal]), int(row_b[signal]))
    if len(a) != len(b):
        return Divergence(steps, 0, "steps", len(a), len(b))
    return None


def count_mismatches(expected: Words, actual: Words) -> int:
    """Steps (times runs) in which at least one word differs or is missing."""
    steps = min(len(expected.record), len(actual.record))
    missing = abs(expected.record.size - actual.record.size)
    return int(np.count_nonzero(expected.record[:steps] != actual.record[:steps])) + missing


def first_digest_divergence(expected: npt.ArrayLike, actual: npt.ArrayLike) -> int | None:
    """Step at which two digest sequences first differ; a shorter one differs where it ends."""
    a, b = np.asarray(expected, np.uint32), np.asarray(actual, np.uint32)
    steps = min(len(a), len(b))
    where = np.flatnonzero(a[:steps] != b[:steps])
    if where.size:
        return int(where[0])
    return steps if len(a) != len(b) else None

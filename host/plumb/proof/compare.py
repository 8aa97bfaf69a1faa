"""Comparison with the integer model: the first step and signal at which a board, a file or another implementation
differs.

This is the only comparison in the package. A board over a link sends only digests: when a digest differs, the host
requests the words of that step and reports the first word that differs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.spec.records import Words

Digests = npt.NDArray[np.uint32]
"""CRC-32 of each step's record, shape (steps,)."""
WordsOfStep = Callable[[int], Mapping[str, int]]
"""Step -> every word of the board's record of that step, by name; may run the board again."""


@dataclass(frozen=True)
class Divergence:
    """The first word that differs.

    signal: name of the word; "digest" when only the digest is known to differ; "steps" when one side ended before the
    other. actual: None when the board gave no value. run: number of the run, when several were compared at once.
    vector: the golden vector. in_file: True when its file is wrong, not the board.
    """

    step: int
    run: int
    signal: str
    expected: int | None
    actual: int | None
    vector: str | None = None
    in_file: bool = False

    def as_dict(self) -> dict[str, object]:
        """The JSON object `first_divergence` of a run or of a golden vector."""
        values = {"signal": self.signal, "expected": self.expected, "actual": self.actual}
        if self.vector is None:
            return {"step": self.step, "run": self.run, **values}
        return {"vector": self.vector, "step": self.step, **values, "in_file": self.in_file}

    def __str__(self) -> str:
        if self.vector is None:
            return f"step {self.step}, run {self.run}: {self.signal} is {self.actual}, expected {self.expected}"
        where = "its file" if self.in_file else "the board"
        return f"{self.vector} step {self.step}: {self.signal} is {self.actual} in {where}, expected {self.expected}"


def first_divergence(
    expected: Words, actual: Words | Digests, words_of_step: WordsOfStep | None = None
) -> Divergence | None:
    """Lowest step, then lowest run, then first signal in written order; None when every bit agrees.

    actual: the words of every step, or its digests alone. words_of_step is called at most once, for the step whose
    digest differs; without it the signal of a differing digest is "digest". Raises ValueError when the numbers of runs
    differ.
    """
    if isinstance(actual, Words):
        return _first_word(expected, actual)
    digests = expected.digests()
    step = first_digest_divergence(digests, actual)
    if step is None:
        return None
    if step >= len(digests):
        return Divergence(step, 0, "steps", len(digests), len(actual))
    answered = int(actual[step]) if step < len(actual) else None
    return divergence_at(step, expected, {} if words_of_step is None else words_of_step(step), answered)


def _first_word(expected: Words, actual: Words) -> Divergence | None:
    a, b = expected.record, actual.record
    if a.shape[1:] != b.shape[1:]:
        raise ValueError(f"records of {a.shape[1:]} and {b.shape[1:]} runs cannot be compared")
    steps = min(len(a), len(b))
    differs = a[:steps] != b[:steps]
    if differs.any():
        step, *run = (int(i) for i in np.argwhere(differs)[0])
        row_a, row_b = a[(step, *run)], b[(step, *run)]
        signal = next(name for name in expected.names if row_a[name] != row_b[name])
        return Divergence(step, run[0] if run else 0, signal, _value(row_a, signal), _value(row_b, signal))
    if len(a) != len(b):
        return Divergence(steps, 0, "steps", len(a), len(b))
    return None


def divergence_at(step: int, expected: Words, actual: Mapping[str, int], digest: int | None) -> Divergence:
    """The first differing word of a step whose digest differs; signal "digest" when no word in `actual` differs.

    actual: the board's words of that step; {}: unknown. digest: the board's digest; None: it sent none.
    """
    row = expected.record[step]
    for name in expected.names if actual else ():
        value = _value(row, name)
        if actual.get(name) != value:
            return Divergence(step, 0, name, value, actual.get(name))
    return Divergence(step, 0, "digest", int(Words(expected.record[step : step + 1]).digests()[0]), digest)


def _value(row: np.void, name: str) -> int:
    """A word of one step as an int, as `Words` returns it, whatever its stored type."""
    return int(row[name].astype(np.int64))


def count_mismatches(expected: Words | Digests, actual: Words | Digests) -> int:
    """Steps (times runs) in which at least one word, or the digest, differs or is missing."""
    a, b = (one.record if isinstance(one, Words) else one for one in (expected, actual))
    steps = min(len(a), len(b))
    return int(np.count_nonzero(a[:steps] != b[:steps])) + abs(a.size - b.size)


def first_digest_divergence(expected: npt.ArrayLike, actual: npt.ArrayLike) -> int | None:
    """Step at which two digest sequences first differ; a shorter one differs where it ends."""
    a, b = np.asarray(expected, np.uint32), np.asarray(actual, np.uint32)
    steps = min(len(a), len(b))
    where = np.flatnonzero(a[:steps] != b[:steps])
    if where.size:
        return int(where[0])
    return steps if len(a) != len(b) else None

"""The factors that a study varies from run to run, and how values are drawn: a grid, at random, or as a Latin
hypercube.

A factor is a list of choices or a range. Its value in run i depends on the study alone, not on who runs it or in which
order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray

GRID, RANDOM, HYPERCUBE = "grid", "random", "latin-hypercube"
DRAWS = (GRID, RANDOM, HYPERCUBE)

Value = str | float | tuple[str, ...]
"""Value of a factor in one run; a tuple: faults."""


@dataclass(frozen=True)
class Factor:
    """choices: its values; () for a range from low to high, whose logarithm is even if log is true."""

    name: str
    choices: tuple[Value, ...] = ()
    low: float = 0.0
    high: float = 0.0
    log: bool = False

    def at(self, share: float) -> Value:
        """The value at a share of 0 <= share < 1 of all."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.log:
            return float(math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low))))
        return self.low + share * (self.high - self.low)

    def to_json(self) -> object:
        if self.choices:
            return [list(choice) if isinstance(choice, tuple) else choice for choice in self.choices]
        return {"low": self.low, "high": self.high, "log": self.log}


def factor_of(name: str, given: object) -> Factor:
    """A factor from its entry in a study; raises UsageError for anything but choices or a range."""
    if isinstance(given, Sequence) and not isinstance(given, str) and given:
        choices = tuple(_choice(name, one) for one in given)
        if len({type(choice) for choice in choices}) != 1:
            raise UsageError(f"vary.{name} mixes numbers and texts: give choices of one kind")
        return Factor(name, choices)
    if isinstance(given, Mapping):
        unknown = set(given) - {"low", "high", "log"}
        low, high, log = given.get("low"), given.get("high"), given.get("log", False)
        if unknown or not is_number(low) or not is_number(high) or not isinstance(log, bool):
            raise UsageError(f"vary.{name} is no range: write {{ low = NUMBER, high = NUMBER, log = true or false }}")
        assert isinstance(low, int | float) and isinstance(high, int | float)
        if not low < high or (log and low <= 0.0):
            raise UsageError(f"vary.{name}: a range has low < high, and low > 0 where log is true")
        return Factor(name, (), float(low), float(high), log)
    raise UsageError(f"vary.{name}: give a list of choices, or {{ low = NUMBER, high = NUMBER }}")


def is_number(value: object) -> bool:
    """Whether a value of a study is a finite number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number of hundreds of digits
        return False


def _choice(name: str, given: object) -> Value:
    if isinstance(given, str):
        return given
    if isinstance(given, int | float) and is_number(given):
        return float(given)
    if isinstance(given, Sequence) and all(isinstance(one, str) for one in given):
        return tuple(given)
    raise UsageError(f"vary.{name} has the choice {given!r}: give numbers, names, or lists of faults")


def points_of(factors: Sequence[Factor]) -> int:
    """Points of the grid of these factors; raises UsageError for a range, which has no grid."""
    for factor in factors:
        if not factor.choices:
            raise UsageError(f"vary.{factor.name} is a range: list its values, or draw it with draw = '{HYPERCUBE}'")
    return math.prod(len(factor.choices) for factor in factors)


def values_of(factors: tuple[Factor, ...], draw: str, draw_seed: int, runs: int, index: int) -> dict[str, Value]:
    """Values of the factors in run `index` of `runs`, by name."""
    if draw == GRID:
        found: dict[str, Value] = {}
        for factor in reversed(factors):
            index, place = divmod(index, len(factor.choices))
            found[factor.name] = factor.choices[place]
        return {factor.name: found[factor.name] for factor in factors}
    if draw == RANDOM:
        rng = np.random.default_rng([draw_seed, index])
        return {factor.name: factor.at(float(rng.random())) for factor in factors}
    shares = _hypercube(len(factors), draw_seed, runs)
    return {factor.name: factor.at(float(shares[place, index])) for place, factor in enumerate(factors)}


@lru_cache(maxsize=4)
def _hypercube(factors: int, draw_seed: int, runs: int) -> FloatArray:
    """Shares (factors, runs): each factor takes one value in each of `runs` equal strata, in an order of its own."""
    rows = []
    for factor in range(factors):
        rng = np.random.default_rng([draw_seed, factor, runs])
        rows.append((rng.permutation(runs) + rng.random(runs)) / runs)
    return np.array(rows).reshape(factors, runs)

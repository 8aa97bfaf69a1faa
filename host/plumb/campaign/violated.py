"""Runs of a campaign in which an invariant does not hold, each with the command that repeats it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from plumb.campaign import smaller
from plumb.campaign.study import Study
from plumb.errors import PlumbError
from plumb.proof.invariants import Violation, violations_of
from plumb.proof.runs import Run
from plumb.proof.scenario_run import RunRequest

SMALLER_MOST = 2
"""Runs that a batch makes smaller for each invariant: a rule that is broken everywhere must not cost many campaigns."""


@dataclass(frozen=True)
class Violated:
    """The first violation of an invariant in run `index`. time_s, value, limit: in the run that `command` repeats,
    which is the smallest one found with that violation where smaller is true, else the whole run."""

    index: int
    seed: int
    invariant: str
    time_s: float
    value: float
    limit: float
    smaller: bool
    command: str

    def to_json(self) -> dict[str, Any]:  # Any: JSON
        return asdict(self)

    def __str__(self) -> str:
        return str(Violation(self.invariant, self.time_s, self.value, self.limit))

    def is_whole(self) -> bool:
        """Whether every entry is of its kind, for one that a file gave."""
        numbers, texts = (self.time_s, self.value, self.limit), (self.invariant, self.command)
        return (
            isinstance(self.index, int)
            and isinstance(self.seed, int)
            and isinstance(self.smaller, bool)
            and all(isinstance(one, int | float) for one in numbers)
            and all(isinstance(one, str) for one in texts)
        )


def judged(run: Run) -> tuple[Violation, ...]:
    """The first violation of each invariant in a run of a campaign, which has no float64 reference."""
    with np.errstate(invalid="ignore"):
        return violations_of(run)


def violated_by(
    study: Study,
    index: int,
    found: Sequence[Violation],
    before: Iterable[Violated],
    make: Callable[[RunRequest], Run],
) -> list[Violated]:
    """The violations of run `index` with their commands, as small as they can be made. before: those of the batch so
    far. make: runs a request."""
    made = Counter(one.invariant for one in before if one.smaller)
    entries = []
    for violation in found:
        request, there, is_smaller = study.request(index), violation, made[violation.invariant] < SMALLER_MOST
        if is_smaller:
            judge = _judge(violation.invariant, make)
            request, there = smaller.smallest(request, violation, judge, study.conditions_varied)
        command = study.command(index, request)
        entries.append(Violated(index, study.seed(index), *there, is_smaller, command))
    return entries


def _judge(invariant: str, make: Callable[[RunRequest], Run]) -> smaller.Judge:
    def judge(request: RunRequest) -> Violation | None:
        try:
            return next((one for one in judged(make(request)) if one.invariant == invariant), None)
        except (PlumbError, ValueError, ArithmeticError):  # a run that cannot be made violates nothing
            return None

    return judge


def counts(invariants: Iterable[str], found: Iterable[Violated]) -> dict[str, int]:
    """Invariant -> runs that violate it, those counted that none violates."""
    counted = Counter(one.invariant for one in found)
    return {name: counted[name] for name in dict.fromkeys([*invariants, *counted])}


def shown(found: Iterable[Violated]) -> list[Violated]:
    """One violation of each invariant: of those made smaller the one that comes first in its run."""
    best: dict[str, Violated] = {}
    for one in sorted(found, key=lambda one: (not one.smaller, one.time_s, one.index)):
        best.setdefault(one.invariant, one)
    return list(best.values())

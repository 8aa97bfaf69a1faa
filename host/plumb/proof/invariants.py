"""Invariants of a system: what holds in every run of its scenario `random`, whatever the seed draws.

A figure is a number over many runs; an invariant is a rule that no run may break at any moment, judged on the truth of
the simulated physics. `random` draws everything from its seed, and two conditions make a run of it smaller: EVENTS
keeps some of the drawn events, PLAIN_FRAME puts the system's own frame in place of the drawn one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from plumb import systems
from plumb.contract.scenario import Scenario
from plumb.errors import UsageError
from plumb.proof.report import Statement
from plumb.proof.runs import Run
from plumb.spec.system_parts import Part

SCENARIO = "random"
"""The scenario whose runs are judged."""
EVENTS, PLAIN_FRAME = "events", "plain_frame"
"""Conditions of that scenario. EVENTS: bit i is 1 when the i-th drawn event is kept; by default all are. PLAIN_FRAME:
1 for the system's own frame."""


class Violation(NamedTuple):
    """A moment at which an invariant does not hold. time_s: from the start of the run. value: what was found, in the
    invariant's own unit. limit: the bound that it should have kept, in the same unit."""

    invariant: str
    time_s: float
    value: float
    limit: float

    def to_json(self) -> dict[str, Any]:  # Any: JSON
        """invariant, time_s, value and limit by name."""
        return self._asdict()

    def __str__(self) -> str:
        return f"{self.invariant} at {self.time_s:.6g} s: {self.value:.6g}, the limit is {self.limit:.6g}"


class Invariants(Protocol):
    """invariants.py of a system: what holds in every run of its scenario `random`."""

    @property
    def INVARIANTS(self) -> Mapping[str, str]:
        """Name -> one sentence: what holds, with its numbers and their unit."""

    def violations(self, run: Run, /) -> Sequence[Violation]:
        """Where the invariants do not hold, in any order, as often as the part likes; () where all hold. All numbers
        are finite."""

    def events_drawn(self, scenario: Scenario, /) -> int:
        """How many events the seed has drawn, 0 to 52, those counted that the condition `events` leaves out."""


INVARIANTS = Part[Invariants](
    "invariants", Invariants, without="no invariants are declared for its runs", place="judging"
)


def judges(system: str, scenario: str) -> bool:
    """Whether the runs of this scenario are judged."""
    return scenario == SCENARIO and system in systems.with_part(INVARIANTS.name)


def require(system: str, scenarios: Iterable[str | None]) -> None:
    """Raises UsageError for a system without invariants, and for a scenario whose runs they do not judge."""
    systems.load(system, INVARIANTS)
    if any(one != SCENARIO for one in scenarios):
        raise UsageError(f"the invariants of {system} judge the scenario '{SCENARIO}' alone: scenario = '{SCENARIO}'")


def violations_of(run: Run) -> tuple[Violation, ...]:
    """The first violation of each invariant, in order of time; () where all hold. Raises UsageError for a system
    without invariants, and for a violation that its part states wrongly."""
    part = systems.load(run.system, INVARIANTS)
    first: dict[str, Violation] = {}
    for one in part.violations(run):
        if one.invariant not in part.INVARIANTS:
            raise UsageError(f"invariants.py of {run.system} does not declare '{one.invariant}'")
        if not all(map(math.isfinite, one[1:])):
            raise UsageError(f"invariants.py of {run.system} has no finite numbers for {one.invariant}: {one[1:]}")
        if one.invariant not in first or one.time_s < first[one.invariant].time_s:
            first[one.invariant] = Violation(one.invariant, *map(float, one[1:]))
    return tuple(sorted(first.values(), key=lambda one: (one.time_s, one.invariant)))


def statements(system: str, found: Sequence[Violation]) -> list[Statement]:
    """Statements about a run: one for each violation, or that every invariant holds."""
    declared = systems.load(system, INVARIANTS).INVARIANTS
    if not found:
        return [Statement("invariants", f"all {len(declared)} hold", True)]
    return [Statement("violated", f"{one} ({declared[one.invariant]})", False) for one in found]

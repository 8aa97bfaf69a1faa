"""A run in which an invariant is violated, made as small as it can be with the violation still in it.

Three things are made smaller, in this order: the set of drawn events, by halves; the length; the frame. Each change is
kept only while the same invariant is still violated. Whatever results is the run of one ordinary command line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from plumb import systems
from plumb.proof import scenario_run
from plumb.proof.invariants import EVENTS, INVARIANTS, PLAIN_FRAME, Violation
from plumb.proof.scenario_run import RunRequest

Judge = Callable[[RunRequest], Violation | None]
"""Makes a run, and gives the first violation of the invariant in it; None where it holds."""
SHORTEST_S = 1.0
"""No scenario is shorter."""
LATER = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Ends that are tried, in s behind the violation: some are found only when something has lasted."""


def smallest(request: RunRequest, found: Violation, judge: Judge, left: frozenset[str]) -> tuple[RunRequest, Violation]:
    """The smallest run, and the violation in it. request: the run with the violation `found`. left: conditions that
    stay as they are."""
    known = set(systems.load(request.system).CONDITIONS) - left
    best = request, found

    def violated(trial: RunRequest) -> bool:
        nonlocal best
        again = judge(trial)
        if again is not None:
            best = trial, again
        return again is not None

    if EVENTS in known:
        kept = events_of(request)
        fewest(kept, lambda events: violated(_with(request, EVENTS, sum(1 << event for event in events))))
    ends_earlier(best[0], best[1], violated)
    if PLAIN_FRAME in known and _number(best[0], PLAIN_FRAME) != 1.0:
        violated(_with(best[0], PLAIN_FRAME, 1))
    return best


def events_of(request: RunRequest) -> list[int]:
    """Numbers of the drawn events that a run has."""
    drawn = systems.load(request.system, INVARIANTS).events_drawn(scenario_run.draw(request).scenario)
    mask = _number(request, EVENTS)
    return [event for event in range(drawn) if mask is None or int(mask) >> event & 1]


def fewest(events: Sequence[int], violated: Callable[[Sequence[int]], bool]) -> list[int]:
    """Leave out all events, then each half of them, each quarter, and so on down to single ones, as long as the
    violation stays; at most some 2 n trials. Gives the events that are left."""
    kept, size = list(events), len(events)
    while size:
        begin = 0
        while begin < len(kept):
            trial = kept[:begin] + kept[begin + size :]
            if (trial or size == len(events)) and violated(trial):
                kept = trial
            else:
                begin += size
        size //= 2
    return kept


def ends_earlier(request: RunRequest, found: Violation, violated: Callable[[RunRequest], bool]) -> bool:
    """Try the ends behind the violation, the earliest first, in tenths of a second; whether one is violated."""
    scenario = scenario_run.draw(request).scenario
    length_s = scenario.steps * scenario.period_us * 1e-6
    step_s = scenario.period_us * 1e-6
    ends = (max(SHORTEST_S, math.ceil(10.0 * (found.time_s + step_s + later) - 1e-6) / 10.0) for later in LATER)
    return any(violated(replace(request, seconds=end)) for end in dict.fromkeys(ends) if end < length_s)


def _number(request: RunRequest, condition: str) -> float | None:
    """The value that the request gives to a condition, None: its default. The last one counts, as for a run."""
    given = [text.partition("=")[2] for text in request.conditions if text.partition("=")[0] == condition]
    return float(given[-1]) if given else None


def _with(request: RunRequest, condition: str, number: int) -> RunRequest:
    others = [text for text in request.conditions if text.partition("=")[0] != condition]
    return replace(request, conditions=[*others, f"{condition}={number}"])

"""`quad` with a scenario `random` and invariants: what the vehicles have, small enough to be counted by hand.

A seed draws EVENTS noisy stretches of an accelerometer; every fourth seed has a gyro that stands still instead of one
of them. One invariant forbids that, the other one always holds.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from plumb import systems
from plumb.contract import disturbance
from plumb.proof.invariants import INVARIANTS, Violation
from plumb.proof.runs import Run
from plumb.systems.quad import scenarios as quad

EVENTS = 5
STILL_S = 0.5
"""Longest time for which the count of the gyro may be the same."""
SECONDS = 12.0


def has_fault(seed: int) -> bool:
    return seed % 4 == 1


def fault(seed: int) -> tuple[int, float]:
    """Number of the event with the fault, and its time in s."""
    rng = np.random.default_rng([seed, 1])
    return int(rng.integers(EVENTS)), round(float(rng.uniform(2.0, 8.0)), 2)


def drawn(seed: int) -> list[str]:
    found = [f"noisy:accel_y@{1 + event}-{1.5 + event}" for event in range(EVENTS)]
    if has_fault(seed):
        place, time_s = fault(seed)
        found[place] = f"stuck:gyro@{time_s}"
    return found


def scenario(
    name: str, seed: int, *, events: float = 2.0**EVENTS - 1.0, plain_frame: float = 0.0, **given: Any
) -> Any:  # Any: as quad has them
    """That of `quad`, and `random`: events at fixed times, and a frame whose accelerometer has a narrower band."""
    if name != "random":
        return quad.scenario(name, seed, **given)
    kept = [text for place, text in enumerate(drawn(seed)) if int(events) >> place & 1]
    given["faults"] = (*given.get("faults", ()), *quad.faults([disturbance.parse(text) for text in kept]))
    given["seconds"] = given.get("seconds") or SECONDS
    return quad.scenario("quiet", seed, bandwidth_hz=350.0 if plain_frame else 100.0 + seed % 7, **given)


def still_s(run: Run) -> tuple[float, float]:
    """The longest time for which the gyro stood still, and the moment at which it was STILL_S."""
    period_s, longest, since, moment_s = run.params.period_s, 0, 0, 0.0
    gyro = run.inputs.raw[:, 0]
    for step in range(1, len(gyro)):
        since = since + 1 if gyro[step] == gyro[step - 1] else 0
        if since * period_s > STILL_S + 1e-6 and not moment_s:
            moment_s = step * period_s
        longest = max(longest, since)
    return longest * period_s, moment_s


def violations(run: Run) -> list[Violation]:
    """The violation in question at three moments, the first one in the middle: it alone counts."""
    longest_s, moment_s = still_s(run)
    if not moment_s:
        return []
    return [Violation("moves", time_s, longest_s, STILL_S) for time_s in (moment_s + 1.0, moment_s, moment_s + 2.0)]


def judged_quad(monkeypatch: pytest.MonkeyPatch, **changed: Any) -> None:  # Any: members of the part
    """Let `quad` have the scenario and the invariants. changed: members of its invariants.py."""
    part, scenarios = ModuleType("invariants"), ModuleType("scenarios")
    vars(part).update(
        {
            "INVARIANTS": {"moves": f"the gyro is never still for {STILL_S} s", "counts": "every count is a count"},
            "violations": violations,
            "events_drawn": lambda scenario: EVENTS,
            **changed,
        }
    )
    vars(scenarios).update(
        vars(systems.load("quad")),
        SCENARIOS={**quad.SCENARIOS, "random": "drawn"},
        SECONDS={**quad.SECONDS, "random": SECONDS},
        CONDITIONS={**quad.CONDITIONS, "events": "those that are kept", "plain_frame": "1: its own frame"},
        scenario=scenario,
    )
    load, with_part = systems.load, systems.with_part

    def loaded(name: str, asked: Any = None) -> Any:  # Any: a module of any kind
        own = {None: scenarios, INVARIANTS: part}
        return own[asked] if name == "quad" and asked in own else load(name, asked)

    monkeypatch.setattr(systems, "load", loaded)
    monkeypatch.setattr(systems, "with_part", lambda name: ("quad",) if name == INVARIANTS.name else with_part(name))

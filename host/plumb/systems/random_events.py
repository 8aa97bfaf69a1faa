"""Events of a run: when those of a scenario come; of the scenario that is drawn at random how many, which, and when,
and the conditions that leave some of them out.

At random two to EVENTS_MOST events, in a tenth of the runs none. What an event is, each vehicle says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from plumb.errors import UsageError
from plumb.physics.sensors import Fault

RANDOM = "random"
"""The scenario that is drawn so."""
EVENTS_LEAST, EVENTS_MOST, WITHOUT_EVENTS = 2, 4, 0.1
EVENTS_ALL = 2**EVENTS_MOST - 1
EVENTS_NOTE = f"of {RANDOM}: bit i keeps its i-th drawn event (default {EVENTS_ALL}, all)"

MOMENTS = 20_813
"""Part of the seed of the generator of moments."""


class Happening(NamedTuple):
    """What happens from begin_s on, before end_s; each vehicle says what it is, and what size and number mean."""

    what: str
    begin_s: float
    end_s: float = math.inf
    size: float = 0.0
    number: int = 0


H = TypeVar("H", bound=Happening)


class Event(NamedTuple, Generic[H]):
    """Parts of one event of a run."""

    happenings: tuple[H, ...] = ()
    faults: tuple[Fault, ...] = ()


def later_s(seed: int, most_s: float, which: int = 0) -> float:
    """How much later than written a run has the events of its scenario: 0 to most_s, uniform. The same seed gives the
    same share of it, from a generator of its own: what else a run draws does not change with it. which: further shares
    of the same seed."""
    return most_s * float(np.random.default_rng([MOMENTS, seed, which]).random())


def between(rng: np.random.Generator, least_s: float, most_s: float) -> float:
    """A length of time whose logarithm is uniform."""
    return float(np.exp(rng.uniform(math.log(least_s), math.log(most_s))))


def drawn(
    rng: np.random.Generator,
    kinds: Sequence[Callable[[np.random.Generator, float], Event[H]]],
    from_s: float,
    to_s: float,
) -> tuple[Event[H], ...]:
    """The events of a run, by the time at which they begin. kinds: each draws an event that begins at a time."""
    count = 0 if rng.random() < WITHOUT_EVENTS else int(rng.integers(EVENTS_LEAST, EVENTS_MOST + 1))
    places, begins = rng.integers(len(kinds), size=count), np.sort(rng.uniform(from_s, to_s, count))
    return tuple(kinds[place](rng, begin_s) for place, begin_s in zip(places.tolist(), begins.tolist(), strict=True))


def kept(events: Sequence[Event[H]], mask: int) -> Event[H]:
    """All that happens in the events whose bits are set."""
    left = [event for place, event in enumerate(events) if mask >> place & 1]
    happenings = tuple(one for event in left for one in event.happenings)
    return Event(happenings, tuple(fault for event in left for fault in event.faults))


def check_conditions(scenario: str, events: float, plain_frame: float) -> None:
    """Raises UsageError for conditions that no run of this scenario has."""
    if scenario != RANDOM and (events != EVENTS_ALL or plain_frame):
        raise UsageError(f"events and plain_frame are conditions of the scenario {RANDOM}, not of {scenario}")
    if events not in range(EVENTS_ALL + 1) or plain_frame not in (0.0, 1.0):
        raise UsageError(f"events is a whole number of 0 to {EVENTS_ALL}, plain_frame 0 or 1")

"""Rides drawn at random: speeds, turns and a slope, and what happens at times drawn over the whole ride.

Two to four events a ride, a tenth of the rides has none. An event is a push (up to 5 m/s^2), ice under a wheel or both
(0.3 to 2 s), a rider who steps off (0.2 s to for ever), a rider's switch that chatters without him, a silence of the
receiver, a kerb ahead or behind, hands that lift it, a fault of one encoder or both, or a fault of gyro or
accelerometer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from plumb.physics.sensors import FAULT_KINDS, Fault, FaultKind
from plumb.spec.arrays import FloatArray
from plumb.systems import random_events
from plumb.systems.random_events import Event, between
from plumb.systems.wheels import rides
from plumb.systems.wheels.rides import Happening, Ride

SECONDS, FROM_S = 16.0, 4.0
STREAM = 20_812
"""Of the generator: what a ride is does not change with the noise of its sensors."""
SLOPE_DEG, SHIFT_M, SPEED_EVERY_S, PUSH_MPS2 = 15.0, 0.015, 3.0, 5.0
LEFT, RIGHT = 4, 5
"""Channels of the encoders; those of gyro and accelerometer come first."""


@dataclass(frozen=True)
class RandomRide:
    """changes_s: when the next speed and turn rate are asked for; mps, dps: each of them, the first from FROM_S on."""

    ride: Ride
    changes_s: FloatArray
    mps: FloatArray
    dps: FloatArray
    events: tuple[Event[Happening], ...]

    def asked(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Speed and turn rate that are asked for at these times."""
        at, moves = np.searchsorted(self.changes_s, time_s, side="right"), time_s >= FROM_S
        return np.asarray(self.mps[at] * moves), np.asarray(self.dps[at] * moves)

    def kept(self, mask: int) -> tuple[Ride, tuple[Fault, ...]]:
        """The ride with the events whose bits are set, and their faults."""
        happenings, faults = random_events.kept(self.events, mask)
        return replace(self.ride, happenings=happenings), faults


def _lasting(
    rng: np.random.Generator, what: str, begin_s: float, lasts_s: tuple[float, float], size: float = 0.0,
    number: int = 0,
) -> Event[Happening]:  # fmt: skip
    return Event((Happening(what, begin_s, begin_s + between(rng, *lasts_s), size, number),))


def _fault(
    rng: np.random.Generator, begin_s: float, channels: tuple[int, ...], kinds: tuple[FaultKind, ...]
) -> Event[Happening]:
    end_s = begin_s + between(rng, 0.05, 4.0 * SECONDS)
    return Event((), tuple(Fault(kinds[int(rng.integers(len(kinds)))], one, begin_s, end_s) for one in channels))


EVENTS: tuple[Callable[[np.random.Generator, float], Event[Happening]], ...] = (
    lambda rng, begin_s: Event(
        (Happening(rides.PUSH, begin_s, begin_s + 0.2, float(rng.uniform(-PUSH_MPS2, PUSH_MPS2))),)
    ),
    lambda rng, begin_s: _lasting(rng, rides.ICY, begin_s, (0.3, 2.0), number=int(rng.choice([1, 2]))),
    lambda rng, begin_s: _lasting(rng, rides.ICY, begin_s, (0.3, 2.0), number=int(rng.choice([1, 2, 3]))),
    lambda rng, begin_s: _lasting(rng, rides.OFF, begin_s, (0.2, 2.0 * SECONDS)),
    lambda rng, begin_s: _lasting(
        rng, rides.CHATTER, begin_s, (1.0, 2.0 * SECONDS), number=int(rng.integers(rides.CHATTER_MS))
    ),
    lambda rng, begin_s: _lasting(rng, rides.DEAF, begin_s, (0.05, 5.0)),
    lambda rng, begin_s: _lasting(rng, rides.KERB, begin_s, (0.3, 5.0), number=int(rng.choice([-1, 1]))),
    lambda rng, begin_s: _lasting(rng, rides.LIFT, begin_s, (0.3, 2.0 * SECONDS), float(rng.uniform(-10.0, 10.0))),
    lambda rng, begin_s: _fault(rng, begin_s, (int(rng.choice([LEFT, RIGHT])),), FAULT_KINDS),
    lambda rng, begin_s: _fault(rng, begin_s, (LEFT, RIGHT), ("railed", "stuck", "silent")),
    lambda rng, begin_s: _fault(rng, begin_s, (int(rng.integers(LEFT)),), FAULT_KINDS),
)


def drawn(seed: int) -> RandomRide:
    rng = np.random.default_rng([STREAM, seed])
    ride = Ride(
        "drawn from the seed", SECONDS, slope_deg=float(rng.uniform(-SLOPE_DEG, SLOPE_DEG) * (rng.random() < 0.5)),
        shift_m=float(rng.uniform(-SHIFT_M, SHIFT_M)), by_receiver=bool(rng.random() < 0.5), pushes=False,
    )  # fmt: skip
    changes = round(SECONDS / SPEED_EVERY_S)
    changes_s = np.sort(rng.uniform(FROM_S, SECONDS, changes))
    mps = rng.uniform(-rides.SPEED_MPS, rides.SPEED_MPS, changes + 1)
    dps = rng.choice([-rides.TURN_DPS, 0.0, 0.0, rides.TURN_DPS], changes + 1)
    return RandomRide(ride, changes_s, mps, dps, random_events.drawn(rng, EVENTS, FROM_S, SECONDS))

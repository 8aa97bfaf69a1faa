"""The rides of `wheels`: what is asked for, and what happens.

A hand holds the vehicle upright for 3 s; the rider then stands on it. Speeds are asked for at random times, pushes
come from in front and behind, and rough ground disturbs it all the time, as in `balancer`. What else happens comes at a
time that each run draws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from plumb.systems import random_events
from plumb.systems.random_events import later_s

HELD_S, BEGINS_S = 3.0, 6.0
"""Until when the hand holds it; when the first speed is asked for."""
HAPPENS_S, LATER_S = 10.0, 4.0
"""When ice, the rider's leaving, a silence of the receiver or the last push comes at the earliest, and by how much more
a run may draw it later."""
SPEED_MPS, TURN_DPS, TURN_S = 0.6, 60.0, 3.0
ICE, ON_ICE_S, ON_ICE_MPS2 = 0.05, 0.3, 3.0
"""Friction; the push on ice comes ON_ICE_S before to ON_ICE_S after it begins."""

ICY, OFF, CHATTER, DEAF, KERB, LIFT, PUSH = HAPPENINGS = ("icy", "off", "chatter", "deaf", "kerb", "lift", "push")
"""What happens for a time, its size and number. icy: the wheels of the bits of number, 1 left, 2 right, are on ice.
off: the rider has left; chatter: he has, but his switch closes for 20 of 300 ms, by number ms later. deaf: the receiver
gets no signal. kerb: one stands ahead (number 1) or behind (-1). lift: hands hold it in the air, by size deg forward.
push: by size m/s^2."""
CHATTER_MS, CLOSED_MS = 300, 20
LEFT, RIGHT = 1, 2


class Happening(random_events.Happening):
    """One of HAPPENINGS."""

    def lasts(self, time_s: float) -> bool:
        return self.begin_s <= time_s < self.end_s


@dataclass(frozen=True)
class Ride:
    """slope_deg: upwards ahead. shift_m: of the centre of mass of rider and body together, forward. ice: which wheels,
    left and right, slip; for ice_s from happens_s on, with a push slips_s later. speed_mps, then_mps: asked for before
    and after that push, else speeds at random. turns: 60 deg/s and 0 in turn. leaves: the rider steps off at happens_s.
    silent_s: of the receiver, from happens_s on; by_receiver: it steers. topples: a push that nobody can balance, at
    happens_s. happenings: further events."""

    title: str
    seconds: float = 20.0
    slope_deg: float = 0.0
    shift_m: float = 0.0
    ice: tuple[bool, bool] = (False, False)
    ice_s: float = 0.0
    speed_mps: float | None = None
    then_mps: float = 0.4
    turns: bool = False
    leaves: bool = False
    by_receiver: bool = False
    silent_s: float = 0.0
    topples: bool = False
    pushes: bool = True
    happenings: tuple[Happening, ...] = ()
    happens_s: float = HAPPENS_S
    slips_s: float = ON_ICE_S

    def happens(self) -> tuple[Happening, ...]:
        """All events but pushes."""
        on_ice = LEFT * self.ice[0] + RIGHT * self.ice[1]
        own = (
            Happening(ICY, self.happens_s, self.happens_s + self.ice_s, number=on_ice) if self.ice_s else None,
            Happening(OFF, self.happens_s) if self.leaves else None,
            Happening(DEAF, self.happens_s, self.happens_s + self.silent_s) if self.silent_s else None,
        )
        return (*(one for one in own if one), *self.happenings)


LEVEL = Ride("level ground, pushes, a new speed every few seconds")
STEADY = Ride("level ground at 0.4 m/s", 18.0, speed_mps=0.4, pushes=False)
RIDES = {
    "level": LEVEL,
    "slope": replace(LEVEL, title="up and down a slope of 10 deg, pushes", slope_deg=10.0),
    "shifted": replace(LEVEL, title="the mass shifted forward by 15 mm, pushes", shift_m=0.015),
    "turns": replace(LEVEL, title="turn rates of 0 and 60 deg/s in turn, pushes", turns=True),
    "ice-one": replace(
        STEADY, title="the left wheel on ice for 2 s: pushed, slows to 0.1 m/s", then_mps=0.1, ice=(True, False),
        ice_s=2.0,
    ),
    "ice-both": replace(
        STEADY, title="both wheels on ice for 1 s: pushed, slows to 0.1 m/s", then_mps=0.1, ice=(True, True), ice_s=1.0,
    ),
    "steps-off": replace(STEADY, title="the rider steps off at 0.4 m/s", leaves=True),
    "receiver": replace(
        LEVEL, title="steered by a receiver that falls silent for a second", seconds=18.0, by_receiver=True, turns=True,
        silent_s=1.0,
    ),
    "topples": replace(STEADY, title="a push that nobody can balance", topples=True),
}  # fmt: skip
"""Name -> ride, its times the earliest."""


def drawn(name: str, seed: int) -> Ride:
    """The ride of a run."""
    slips_s = later_s(seed, 2.0 * ON_ICE_S, 1) - ON_ICE_S
    return replace(RIDES[name], happens_s=HAPPENS_S + later_s(seed, LATER_S), slips_s=slips_s)

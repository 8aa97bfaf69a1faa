"""Flights drawn at random: a pilot, wind, and what happens at times drawn over the whole flight.

Two to four events a flight, a tenth of the flights has none. An event is a cut of the throttle (0.2 to 3 s), a silence
of the receiver (0.05 to 5 s), a gust (3 to 8 m/s), a weak rotor (10 to 50 %), a fault of a sensor (50 ms to for ever,
one axis or all), a step of the gyro's bias (0.5 to 5 deg/s), vibration (0.3 to 2 g), or a battery that sags (to 12 %).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from plumb.physics import pilots
from plumb.physics.airframe import G_MPS2, Airframe, command_for
from plumb.physics.sensors import Fault, FaultKind
from plumb.systems import random_events
from plumb.systems.quadrotor import courses, random_frames
from plumb.systems.quadrotor.courses import ACTS_S, REST_S, Course, Happening, Turn
from plumb.systems.random_events import Event, between

SECONDS, WIND_MPS = 30.0, 10.0
STREAM = 20_811
"""Of the generator: what a flight is does not change with the noise of its sensors."""
HELD = pilots.Leaning(pitch_rad=pilots.HELD_DEG * pilots.DEG)
KEEPS_ON_S, CLIMB_SHARE, CLIMB_MOST_S = 8.0, 0.9, 6.0
GYRO, ACCEL = range(3), range(3, 6)


@dataclass(frozen=True)
class Flight:
    """lands: what the board does without a receiver."""

    frame: Airframe
    course: Course
    events: tuple[Event[Happening], ...]
    lands: bool


def _lasting(rng: np.random.Generator, what: str, begin_s: float, least_s: float, most_s: float) -> Event[Happening]:
    return Event((Happening(what, begin_s, begin_s + between(rng, least_s, most_s)),))


def _bias(rng: np.random.Generator, begin_s: float) -> Event[Happening]:
    axes = int(rng.choice([1, 2, 4, 7]))
    step_dps = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 5.0)) / math.sqrt(axes.bit_count())
    return Event((Happening(courses.BIAS, begin_s, size=step_dps, number=axes),))


def _fault(rng: np.random.Generator, begin_s: float) -> Event[Happening]:
    kinds: tuple[FaultKind, ...] = ("railed", "stuck", "flickering", "amplified", "missing")
    kind = kinds[int(rng.integers(len(kinds)))]
    axes = GYRO if rng.random() < 0.5 else ACCEL
    channels = [*GYRO, *ACCEL] if kind == "missing" else axes if rng.random() < 0.5 else [int(rng.choice(axes))]
    end_s = begin_s + between(rng, 0.05, SECONDS)
    return Event((), tuple(Fault(kind, channel, begin_s, end_s) for channel in channels))


EVENTS: tuple[Callable[[np.random.Generator, float], Event[Happening]], ...] = (
    lambda rng, begin_s: _lasting(rng, courses.CUT, begin_s, 0.2, 3.0),
    lambda rng, begin_s: _lasting(rng, courses.DEAF, begin_s, 0.05, 5.0),
    lambda rng, begin_s: Event((Happening(courses.GUST, begin_s, size=rng.uniform(3.0, 8.0)),)),
    lambda rng, begin_s: Event(
        (Happening(courses.WEAK, begin_s, size=rng.uniform(0.1, 0.5), number=int(rng.integers(4))),)
    ),
    _fault,
    _bias,
    lambda rng, begin_s: Event((Happening(courses.SHAKE, begin_s, size=rng.uniform(0.3, 2.0)),)),
    lambda rng, begin_s: Event((Happening(courses.SAG, begin_s, size=rng.uniform(0.0, 0.12)),)),
)


def _climb_and_cut(rng: np.random.Generator, course: Course, frame: Airframe) -> Course:
    """A climb of 5 to 30 m/s, with twice the weight of thrust if the frame has it, and a cut at its end."""
    share = min(2.0, CLIMB_SHARE * frame.thrust_max_n / frame.weight_n)
    begin_s, lasts_s = rng.uniform(ACTS_S, 18.0), rng.uniform(5.0, 30.0) / (G_MPS2 * (share - 1.0))
    top_s = begin_s + min(lasts_s, CLIMB_MOST_S)
    throttle = float(command_for(np.array(share * frame.weight_n / frame.thrust_max_n)))
    climb = Happening(courses.THROTTLE, begin_s, top_s, throttle)
    cut = Happening(courses.CUT, top_s, top_s + rng.uniform(0.2, 2.0))
    return replace(course, pilot=pilots.centred, happenings=(climb, cut))


def _chops(rng: np.random.Generator, course: Course, _frame: Airframe) -> Course:
    begins = np.sort(rng.uniform(ACTS_S, SECONDS, int(rng.integers(4, 11))))
    return replace(
        course, pilot=pilots.place,
        happenings=tuple(Happening(courses.CUT, at, at + rng.uniform(0.1, 0.6)) for at in begins.tolist()),
    )  # fmt: skip


def _flips(rng: np.random.Generator, course: Course, _frame: Airframe) -> Course:
    begins = ACTS_S + np.arange(int(rng.integers(1, 5))) * 5.0 + rng.uniform(0.0, 1.0)
    axis, side = int(rng.integers(2)), float(rng.choice([-400.0, 400.0]))
    asked = (side, 0.0, 0.0) if axis == 0 else (0.0, side, 0.0)
    return replace(
        course, pilot=pilots.centred, turns=tuple(Turn(at, at + rng.uniform(0.2, 1.0), asked) for at in begins.tolist())
    )


def _lands(rng: np.random.Generator, course: Course, _frame: Airframe) -> Course:
    """Soft, at 1 m/s, with a bounce, or with the engine off above the ground; level or on a slope of 10 deg."""
    sink_mps, touched_m = ((0.5, 0.01), (1.0, 0.01), (1.8, 0.01), (0.5, 0.3))[int(rng.integers(4))]
    return replace(
        course, pilot=pilots.place, lands=True, climb_m=rng.uniform(1.0, 4.0), land_at_s=rng.uniform(11.0, 16.0),
        sink_mps=sink_mps, touched_m=touched_m, keeps_on_s=KEEPS_ON_S,
        slope_rad=math.radians(10.0) if rng.random() < 0.3 else 0.0,
    )  # fmt: skip


PILOTS: tuple[Callable[[np.random.Generator, Course, Airframe], Course], ...] = (
    lambda _rng, course, _frame: replace(course, pilot=pilots.centred),
    lambda _rng, course, _frame: replace(course, pilot=pilots.place),
    lambda _rng, course, _frame: replace(course, pilot=HELD),
    lambda _rng, course, _frame: replace(course, pilot=pilots.sticks),
    lambda _rng, course, _frame: replace(course, pilot=pilots.shuttle),
    lambda _rng, course, _frame: replace(course, pilot=pilots.orbit),
    _climb_and_cut,
    _chops,
    _flips,
    _lands,
)


def drawn(seed: int) -> Flight:
    rng = np.random.default_rng([STREAM, seed])
    frame = random_frames.drawn(rng)
    lands = bool(rng.random() < 0.5)
    course = Course("drawn from the seed", pilots.centred, SECONDS, wind_mps=rng.uniform(0.0, WIND_MPS))
    course = PILOTS[int(rng.integers(len(PILOTS)))](rng, course, frame)
    return Flight(frame, course, random_events.drawn(rng, EVENTS, REST_S, SECONDS), lands)


def kept(flight: Flight, mask: int) -> tuple[Course, tuple[Fault, ...]]:
    """The course with the events whose bits are set, and their faults."""
    happenings, faults = random_events.kept(flight.events, mask)
    return replace(flight.course, happenings=(*flight.course.happenings, *happenings)), faults

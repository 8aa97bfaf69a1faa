"""The flights of `quadrotor`: what the pilot does, and what happens.

A flight begins with 5 s at rest on a stand 30 m above the ground, or on the ground. The stand then lets go of a body
whose rotors turn as in a hover, and 2 s later the pilot begins. Pilots are those of `plumb.physics.pilots`: they see
place and speed 0.2 s late, and hold the height by eye. In mode rate the sticks follow a table of times.

Times are those of COURSES, and in a course with later_s what the pilot does and what happens comes later by a time that
each run draws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from plumb.physics import pilots
from plumb.physics.imu import MPU6050, TWO_CHIPS, ImuGrade
from plumb.systems import random_events
from plumb.systems.random_events import later_s

REST_S, SETTLED_S = 5.0, 2.0
ACTS_S = REST_S + SETTLED_S
"""When the pilot begins."""
HAPPENS_S = 9.0
"""When a gust, a push or a weak motor comes."""
HEIGHT_M, CLIMB_MPS, SINK_MPS = 30.0, 1.0, 0.5
WIND_MPS, GUST_MPS, WEAK_SHARE, KICK_RADPS, KICK_S = 5.0, 6.0, 0.8, 17.5, 0.01
"""GUST_MPS: step of the wind; WEAK_SHARE: what is left of one rotor's thrust; KICK_RADPS: rate about x that a push
of KICK_S leaves."""
TOUCHED_M = 0.01
"""Height of the legs at which a pilot takes it for landed."""
LEAN_DEG, LEAN_S = 20.0, 2.0
MPU6050_LINK, TWO_CHIPS_LINK = {"accel_bus": 2}, {"accel_bus": 0}
"""Parameters that set the sensors of the board."""
STEP_DPS = 200.0


class Turn(NamedTuple):
    """Mode rate from begin_s to end_s: rates of roll, pitch and yaw that the sticks ask for."""

    begin_s: float
    end_s: float
    rate_dps: tuple[float, float, float]


class Happening(random_events.Happening):
    """One of HAPPENINGS."""

    def begun(self, time_s: float) -> bool:
        return self.begin_s - INSTANT_S <= time_s

    def lasts(self, time_s: float) -> bool:
        return self.begun(time_s) and time_s < self.end_s - INSTANT_S


INSTANT_S = 1e-9
"""A time of the grid is not before itself."""
CUT, DEAF, GUST, WEAK, BIAS, SHAKE, SAG, KICK, THROTTLE = (
    "cut", "deaf", "gust", "weak", "bias", "shake", "sag", "kick", "throttle",
)  # fmt: skip
HAPPENINGS = {
    CUT: "the throttle is low",
    DEAF: "the receiver gets no signal",
    GUST: "size: more wind, m/s, in its direction",
    WEAK: "size: share of its thrust that rotor `number` loses",
    BIAS: "size: step of the gyro's bias, deg/s, on the axes whose bits are set in `number`",
    SHAKE: "size: unbalance of each rotor, g in a hover, instead of the course's",
    SAG: "size: share of the thrust that the battery loses within SAG_S",
    KICK: "size: rate about x, rad/s, by an even push",
    THROTTLE: "size: the throttle, 0 to 1, whatever the height",
}
"""What -> how. Their places are those of the bits of `happening` in the truth, and of happening_t in plant_flight.h."""
SAG_S = 1.0


@dataclass(frozen=True)
class Course:
    """lands: takes off from the ground, which rises by slope_rad towards +x, climbs by climb_m at CLIMB_MPS, and lands
    from land_at_s on: the throttle is low when the legs are less than touched_m above the ground, and the switch off
    keeps_on_s later. begin_m: height at the beginning otherwise. turns: in mode rate. supply: share of the full thrust
    that the battery gives. held: the stand does not let go, and the throttle stays low; on_its_back: it lies there
    upside down. acts_s: when the pilot begins. later_s: turns, happenings, the landing and the pilot's lean come 0 to
    so much later, in the course of a run by so much; a pilot that holds a place begins at acts_s."""

    title: str
    pilot: pilots.Pilot
    seconds: float = 20.0
    wind_mps: float = 0.0
    lands: bool = False
    slope_rad: float = 0.0
    climb_m: float = 3.0
    land_at_s: float = 20.0
    sink_mps: float = SINK_MPS
    touched_m: float = TOUCHED_M
    keeps_on_s: float = 0.0
    begin_m: float = HEIGHT_M
    grade: ImuGrade = MPU6050
    vibration_g: float = 0.3
    turns: tuple[Turn, ...] = ()
    happenings: tuple[Happening, ...] = ()
    supply: float = 1.0
    held: bool = False
    on_its_back: bool = False
    acts_s: float = ACTS_S
    later_s: float = 0.0

    def moved(self, later_s: float) -> Course:
        """The course in which all of this comes so much later."""
        turns = (one._replace(begin_s=one.begin_s + later_s, end_s=one.end_s + later_s) for one in self.turns)
        happenings = (one._replace(begin_s=one.begin_s + later_s, end_s=one.end_s + later_s) for one in self.happenings)
        leans_s = later_s if isinstance(self.pilot, pilots.Leaning) else 0.0
        return replace(
            self, acts_s=self.acts_s + leans_s, land_at_s=self.land_at_s + later_s, turns=tuple(turns),
            happenings=tuple(happenings), later_s=later_s,
        )  # fmt: skip

    def lasting(self, what: str, time_s: float) -> Happening | None:
        """The last of these happenings that lasts at a time."""
        return next((one for one in reversed(self.happenings) if one.what == what and one.lasts(time_s)), None)


leans = pilots.Leaning(pitch_rad=LEAN_DEG * pilots.DEG, until_s=LEAN_S)
"""20 deg of pitch for 2 s, then level."""
turns_about = pilots.Leaning(yaw_radps=180.0 * pilots.DEG, until_s=LEAN_S)
"""Level; a full stick of yaw for 2 s."""


CALM = Course("calm, a pilot holds the place", pilots.place)
WINDY = replace(CALM, title="wind of 5 m/s with gusts, a pilot holds the place", wind_mps=WIND_MPS)
LEVEL = Course("sticks centred", pilots.centred, 14.0, later_s=3.0)
COURSES = {
    "calm": CALM,
    "wind": WINDY,
    "take-off": Course("take-off and landing", pilots.place, 30.0, lands=True, land_at_s=16.0, later_s=4.0),
    "sticks": Course("sticks: +-35 deg, a new value every 0.7 s", pilots.sticks),
    "lean": Course("20 deg of pitch for 2 s, sticks centred before and after", leans, 14.0, later_s=3.0),
    "rate": replace(
        LEVEL, title="mode rate: 200 deg/s of roll for 0.3 s, and back", turns=(
            Turn(ACTS_S, ACTS_S + 0.3, (STEP_DPS, 0.0, 0.0)), Turn(ACTS_S + 0.3, ACTS_S + 0.6, (-STEP_DPS, 0.0, 0.0)),
        ),
    ),
    "tip": replace(
        LEVEL, title="rolled to 60 deg in mode rate, then level",
        turns=(Turn(ACTS_S, ACTS_S + 0.24, (300.0, 0.0, 0.0)),),
    ),
    "flip": replace(
        LEVEL, title="a flip in mode rate, then level", turns=(Turn(ACTS_S, ACTS_S + 0.93, (400.0, 0.0, 0.0)),),
    ),
    "overturned": replace(
        LEVEL, title="rolled upside down in mode rate, then level",
        turns=(Turn(ACTS_S, ACTS_S + 0.48, (400.0, 0.0, 0.0)),),
    ),
    "kick": replace(
        LEVEL, title="a push tips it by 50 deg", seconds=14.0,
        happenings=(Happening(KICK, HAPPENS_S, HAPPENS_S + KICK_S, KICK_RADPS),),
    ),
    "gust": replace(
        CALM, title="a step of the wind by 6 m/s", seconds=14.0, later_s=3.0,
        happenings=(Happening(GUST, HAPPENS_S, size=GUST_MPS),),
    ),
    "weak": replace(
        CALM, title="one rotor loses a fifth of its thrust", seconds=14.0, later_s=3.0,
        happenings=(Happening(WEAK, HAPPENS_S, size=1.0 - WEAK_SHARE),),
    ),
    "yaw": Course("a full stick of yaw for 2 s with an empty battery", turns_about, 14.0, supply=0.45, later_s=3.0),
    "lost": replace(
        CALM, title="the receiver is lost for good", seconds=12.0, begin_m=60.0, later_s=2.0,
        happenings=(Happening(DEAF, 8.0),),
    ),
    "heard-again": replace(
        CALM, title="the receiver is lost for 0.4 s", seconds=12.0, later_s=2.0, happenings=(Happening(DEAF, 8.0, 8.4),)
    ),
    "lost-low": replace(
        CALM, title="the receiver is lost just above the ground", seconds=12.0, lands=True, climb_m=0.5, land_at_s=6.0,
        later_s=2.0, happenings=(Happening(DEAF, 6.2),),
    ),
    "cut": replace(
        CALM, title="the throttle is cut, then the receiver lost", seconds=11.0, later_s=2.0,
        happenings=(Happening(CUT, 8.0), Happening(DEAF, 8.02)),
    ),
    "idle": Course("on its stand, rotors on, the throttle low", pilots.centred, 16.0, held=True, vibration_g=0.0),
    "on-its-back": Course("on its back, rotors on, the throttle low", pilots.centred, 8.0, held=True, on_its_back=True),
    "two-chips": replace(WINDY, title="wind of 5 m/s, ADXL345 and ITG-3205", grade=TWO_CHIPS),
}  # fmt: skip
"""Name -> flight, its times the earliest."""


def drawn(name: str, seed: int) -> Course:
    """The flight of a run."""
    course = COURSES[name]
    return course.moved(later_s(seed, course.later_s))

"""The flights of `quadrotor`: what the pilot does, and what happens.

A flight begins with 5 s at rest on a stand 30 m above the ground, or on the ground. The stand then lets go of a body
whose rotors turn as in a hover, and 2 s later the pilot begins. Pilots are those of `plumb.physics.pilots`: they see
place and speed 0.2 s late, and hold the height by eye. In mode rate the sticks follow a table of times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from plumb.physics import pilots
from plumb.physics.imu import MPU6050, TWO_CHIPS, ImuGrade

REST_S, SETTLED_S = 5.0, 2.0
ACTS_S = REST_S + SETTLED_S
"""When the pilot begins."""
HAPPENS_S = 9.0
"""When a gust, a push or a weak motor comes."""
HEIGHT_M, CLIMB_MPS, SINK_MPS = 30.0, 1.0, 0.5
WIND_MPS, GUST_MPS, WEAK_SHARE, KICK_RADPS = 5.0, 6.0, 0.8, 17.5
"""GUST_MPS: step of the wind; WEAK_SHARE: what is left of one rotor's thrust; KICK_RADPS: rate about x that a push of
10 ms leaves."""
LEAN_DEG, LEAN_S = 20.0, 2.0
MPU6050_LINK, TWO_CHIPS_LINK = {"accel_bus": 2}, {"accel_bus": 0}
"""Parameters that tell the board which sensors it has."""
STEP_DPS = 200.0


@dataclass(frozen=True)
class Turn:
    """Mode rate from begin_s to end_s: rates of roll, pitch and yaw that the sticks ask for."""

    begin_s: float
    end_s: float
    rate_dps: tuple[float, float, float]


@dataclass(frozen=True)
class Course:
    """lands: takes off from the ground, climbs by climb_m, and lands from land_at_s on. turns: in mode rate. gust_mps,
    kick_radps, weak: at happens_s.
    lost_s: from when to when the receiver hears nothing. supply: share of the full thrust that the battery gives.
    cut_s: from when on the throttle is low. held: the stand does not let go, and the throttle stays low; on_its_back:
    it lies there upside down."""

    title: str
    pilot: pilots.Pilot
    seconds: float = 20.0
    wind_mps: float = 0.0
    lands: bool = False
    climb_m: float = 3.0
    land_at_s: float = 20.0
    grade: ImuGrade = MPU6050
    vibration_g: float = 0.3
    turns: tuple[Turn, ...] = ()
    gust_mps: float = 0.0
    kick_radps: float = 0.0
    weak: bool = False
    happens_s: float = HAPPENS_S
    lost_s: tuple[float, float] = (0.0, 0.0)
    supply: float = 1.0
    cut_s: float = float("inf")
    held: bool = False
    on_its_back: bool = False


def leans(seen: pilots.Seen) -> pilots.Lean:
    """20 deg of pitch for 2 s, then level."""
    leaning = LEAN_DEG if seen.time_s < LEAN_S else 0.0
    return seen.zero, seen.zero + pilots.DEG * leaning, seen.zero


def turns_about(seen: pilots.Seen) -> pilots.Lean:
    """Level; a full stick of yaw for 2 s."""
    return seen.zero, seen.zero, seen.zero + (pilots.DEG * 180.0 if seen.time_s < LEAN_S else 0.0)


CALM = Course("calm, a pilot holds the place", pilots.place)
WINDY = replace(CALM, title="wind of 5 m/s with gusts, a pilot holds the place", wind_mps=WIND_MPS)
LEVEL = Course("sticks centred", pilots.centred, 12.0)
COURSES = {
    "calm": CALM,
    "wind": WINDY,
    "take-off": Course("take-off and landing", pilots.place, 30.0, lands=True),
    "sticks": Course("sticks: +-35 deg, a new value every 0.7 s", pilots.sticks),
    "lean": Course("20 deg of pitch for 2 s, sticks centred before and after", leans, 12.0),
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
    "kick": replace(LEVEL, title="a push tips it by 50 deg", seconds=14.0, kick_radps=KICK_RADPS),
    "gust": replace(CALM, title="a step of the wind by 6 m/s", seconds=14.0, gust_mps=GUST_MPS),
    "weak": replace(CALM, title="one rotor loses a fifth of its thrust", seconds=14.0, weak=True),
    "yaw": Course("a full stick of yaw for 2 s with an empty battery", turns_about, 12.0, supply=0.45),
    "lost": replace(CALM, title="the receiver is lost for good", seconds=11.0, lost_s=(8.0, 99.0)),
    "heard-again": replace(CALM, title="the receiver is lost for 0.4 s", seconds=12.0, lost_s=(8.0, 8.4)),
    "lost-low": replace(
        CALM, title="the receiver is lost just above the ground", seconds=12.0, lands=True, climb_m=0.5, land_at_s=6.0,
        lost_s=(6.2, 99.0),
    ),
    "cut": replace(
        CALM, title="the throttle is cut, then the receiver lost", seconds=9.0, cut_s=8.0, lost_s=(8.02, 99.0)
    ),
    "idle": Course("on its stand, rotors on, the throttle low", pilots.centred, 16.0, held=True, vibration_g=0.0),
    "on-its-back": Course("on its back, rotors on, the throttle low", pilots.centred, 8.0, held=True, on_its_back=True),
    "two-chips": replace(WINDY, title="wind of 5 m/s, ADXL345 and ITG-3205", grade=TWO_CHIPS),
}  # fmt: skip
"""Name -> flight."""

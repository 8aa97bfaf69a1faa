"""The flights by name.

A flight begins with 5 s at rest, on a stand 10 m above the ground, or on the ground where it takes off. The stand then
lets go of a body whose rotors turn as in a hover, and 2 s later the pilot begins; a take-off raises the height by 1 m/s
to 3 m, stays until 35 s, and sinks at 0.5 m/s until a leg touches. Errors are scored from 10 s on, of take-offs from
5 s on. Heading, direction of the wind, sticks and sensors are drawn for every seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumb.physics import pilots
from plumb.physics.airframe import HUMMINGBIRD, IRIS, Airframe
from plumb.physics.imu import MPU6050, TWO_CHIPS, ImuGrade


@dataclass(frozen=True)
class Flight:
    """wind_mps: mean wind, with gusts; slope_rad, lands: takes off from this slope and lands on it; supply_lost: share
    of the full thrust that the battery loses in ten minutes; vibration_g: of each rotor in a hover."""

    title: str
    pilot: pilots.Pilot
    wind_mps: float = 0.0
    seconds: float = 60.0
    lands: bool = False
    slope_rad: float = 0.0
    frame: Airframe = HUMMINGBIRD
    grade: ImuGrade = MPU6050
    vibration_g: float = 0.3
    period_us: int = 2500
    supply_lost: float = 0.12

    @property
    def scored_from_s(self) -> float:
        return REST_S if self.lands else SCORED_FROM_S


REST_S, SETTLED_S, SCORED_FROM_S = 5.0, 2.0, 10.0
HEIGHT_M, CLIMB_M, CLIMB_MPS, SINK_MPS, LAND_AT_S = 10.0, 3.0, 1.0, 0.5, 35.0
CRASH_TILT_RAD = np.radians(85.0)
WIND_MPS, GALE_MPS = 5.0, 7.7

CENTRED = Flight("calm, sticks centred", pilots.centred)
PLACE = Flight("calm, a pilot holds the place", pilots.place)
WINDY = replace(PLACE, title="wind 5 m/s with gusts, a pilot holds the place", wind_mps=WIND_MPS)
TAKE_OFF = Flight("take-off and landing, level", pilots.place, lands=True)
STICKS = Flight("sticks: +-35 deg, a new value every 0.7 s", pilots.sticks)
FLIGHTS = {
    "calm-centred": CENTRED,
    "calm-place": PLACE,
    "wind-5-place": WINDY,
    "wind-7.7-place": replace(PLACE, title="wind 7.7 m/s with gusts, a pilot holds the place", wind_mps=GALE_MPS),
    "wind-5-centred": replace(CENTRED, title="wind 5 m/s with gusts, sticks centred", wind_mps=WIND_MPS),
    "pitch-15": Flight("15 deg of pitch held", pilots.held),
    "orbit": Flight("orbit: bank 20 deg, yaw 40 deg/s", pilots.orbit),
    "sticks": STICKS,
    "shuttle": Flight("shuttle: +-25 deg of pitch, 8 s each", pilots.shuttle),
    "take-off": TAKE_OFF,
    "take-off-slope": replace(TAKE_OFF, title="take-off and landing on a slope of 10 deg", slope_rad=np.radians(10.0)),
    "take-off-wind": replace(TAKE_OFF, title="take-off and landing in wind 5 m/s with gusts", wind_mps=WIND_MPS),
    "hover-10-min": replace(PLACE, title="ten minutes of hover, a pilot holds the place", seconds=600.0),
    "two-chips": replace(WINDY, title="wind 5 m/s, place held, ADXL345 and ITG-3205", grade=TWO_CHIPS),
    "two-chips-sticks": replace(STICKS, title="sticks, ADXL345 and ITG-3205", grade=TWO_CHIPS),
    "iris": replace(WINDY, title="wind 5 m/s, place held, iris", frame=IRIS),
    "iris-sticks": replace(STICKS, title="sticks, iris", frame=IRIS),
    "vibration-1g": replace(PLACE, title="calm, place held, vibration of 1 g per rotor", vibration_g=1.0),
    "offset-40mg": replace(
        PLACE, title="calm, place held, accelerometer offset of N(40 mg)", grade=replace(MPU6050, offset_g=0.04)
    ),
    "period-5ms": replace(PLACE, title="calm, place held, every 5 ms", period_us=5000),
}
"""Name -> flight, in the order of the table. The last five are shown, and have no figure to reach."""
EXTRA = ("hover-10-min",)
"""Flights that take long: flown when they are asked for by name."""

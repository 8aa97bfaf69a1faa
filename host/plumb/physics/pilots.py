"""Demands of a pilot: the vertical in body axes, a yaw rate, and the collective thrust.

Pilots see the true state. A pilot that holds a place sees position and speed of 0.2 s ago and leans against them by at
most 20 deg. Every pilot holds the height by eye and knows the lean of the body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plumb.physics.airframe import G_MPS2, Airframe
from plumb.physics.elementary import arctangent, cosine, sine
from plumb.physics.quadrotor import Quadrotor
from plumb.spec.arrays import FloatArray

Lean = tuple[FloatArray, FloatArray, FloatArray]
"""Roll and pitch in rad (nose and right side down are positive), and yaw rate in rad/s, (runs,) each."""
Pilot = Callable[["Seen"], Lean]

DEG = np.pi / 180.0
"""1 deg in rad."""
SEEN_LATE_S, LEAN_MAX_RAD = 0.2, np.radians(20.0)
PLACE_PER_S2, SPEED_PER_S, PLACE_SUM_PER_S3 = 0.5, 1.1, 0.06
STICKS_DEG, STICKS_EVERY_S = 35.0, 0.7
SHUTTLE_DEG, SHUTTLE_S = 25.0, 8.0
HELD_DEG, ORBIT_BANK_DEG, ORBIT_YAW_DPS = 15.0, 20.0, 40.0


@dataclass
class Seen:
    """The state that a pilot sees. time_s: since the flight began; position_m, velocity_mps: delayed, earth axes, (3,
    runs); heading: cosine and sine, (2, runs); sticks: drawn values of -1 to 1 for every STICKS_EVERY_S, (times, 2,
    runs); sum_ms: integral of the position, (2, runs)."""

    time_s: float
    position_m: FloatArray
    velocity_mps: FloatArray
    heading: FloatArray
    sticks: FloatArray
    sum_ms: FloatArray

    @property
    def zero(self) -> FloatArray:
        return np.zeros(self.heading.shape[1])


@dataclass(frozen=True)
class Leaning:
    """A pilot that asks for one lean until a time, then for none."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_radps: float = 0.0
    until_s: float = float("inf")

    def __call__(self, seen: Seen) -> Lean:
        share = 1.0 if seen.time_s < self.until_s else 0.0
        return seen.zero + share * self.roll_rad, seen.zero + share * self.pitch_rad, seen.zero + share * self.yaw_radps


centred = Leaning()
held = Leaning(pitch_rad=HELD_DEG * DEG)
orbit = Leaning(roll_rad=ORBIT_BANK_DEG * DEG, yaw_radps=-ORBIT_YAW_DPS * DEG)
"""To the right, nose into the turn."""


def place(seen: Seen) -> Lean:
    accel = -(PLACE_PER_S2 * seen.position_m[:2] + SPEED_PER_S * seen.velocity_mps[:2] + PLACE_SUM_PER_S3 * seen.sum_ms)
    cosine, sine = seen.heading
    forward, left = accel[0] * cosine + accel[1] * sine, accel[1] * cosine - accel[0] * sine
    roll, pitch = arctangent(-left / G_MPS2), arctangent(forward / G_MPS2)
    return np.clip(roll, -LEAN_MAX_RAD, LEAN_MAX_RAD), np.clip(pitch, -LEAN_MAX_RAD, LEAN_MAX_RAD), seen.zero


def sticks(seen: Seen) -> Lean:
    roll, pitch = STICKS_DEG * DEG * seen.sticks[int(seen.time_s / STICKS_EVERY_S)]
    return roll, pitch, seen.zero


def shuttle(seen: Seen) -> Lean:
    side = 1.0 if int(seen.time_s / SHUTTLE_S) % 2 == 0 else -1.0
    return seen.zero, seen.zero + side * (SHUTTLE_DEG * DEG), seen.zero


def vertical(roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """The vertical in body axes for this lean: positive pitch accelerates forward, positive roll to the right."""
    level = cosine(pitch)
    return np.stack([-sine(pitch), sine(roll) * level, cosine(roll) * level])


HEIGHT_PER_S2, CLIMB_PER_S, HEIGHT_SUM_PER_S3 = 2.0, 2.5, 0.6
SUM_LIMIT_MS, THRUST_MOST = 5.0, 0.9


class Collective:
    """Holds a height by eye: thrust in N from height and climb; THRUST_MOST: largest share of the rotors'
    thrust."""

    def __init__(self, frame: Airframe, runs: int, period_s: float) -> None:
        self._frame, self._period_s, self._sum_ms = frame, period_s, np.zeros(runs)

    def thrust_n(self, body: Quadrotor, height_m: FloatArray | float, climb_mps: FloatArray | float) -> FloatArray:
        low = height_m - body.position_m[2]
        self._sum_ms = np.clip(self._sum_ms + low * self._period_s, -SUM_LIMIT_MS, SUM_LIMIT_MS)
        slow = climb_mps - body.velocity_mps[2]
        accel = HEIGHT_PER_S2 * low + CLIMB_PER_S * slow + HEIGHT_SUM_PER_S3 * self._sum_ms
        upright = np.maximum(body.matrix[2, 2], 0.5)
        wanted = self._frame.mass_kg * (G_MPS2 + np.clip(accel, -5.0, 8.0)) / upright
        return np.asarray(np.clip(wanted, 0.0, THRUST_MOST * self._frame.thrust_max_n))

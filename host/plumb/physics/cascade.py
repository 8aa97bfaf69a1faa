"""A float controller for flights: attitude P on the cross product of two verticals, rate PI, mixer.

    rate setpoint   = ATTITUDE_GAIN (wanted vertical x estimated vertical) + yaw rate along the vertical
    angular accel.  = RATE_GAIN (error + RATE_INTEGRAL sum of errors), whose torque the rotors make
    mixer           thrusts by the inverse of the airframe's allocation, with the collective moved so that no rotor
                    leaves its range; commands by the inverse of the thrust curve with a full battery

The gyro is taken as it reads, for every estimator alike: a bias of 1 deg/s tilts the body by a sixth of a degree.
The motors' lag (12.5 to 25 ms) with 5 ms of delay and sampling leaves 60 deg of phase at RATE_GAIN.
"""

from __future__ import annotations

import numpy as np

from plumb.physics.airframe import Airframe, command_for
from plumb.physics.vectors import cross, total
from plumb.spec.arrays import BoolArray, FloatArray

ATTITUDE_GAIN, RATE_GAIN, RATE_INTEGRAL, YAW_GAIN = 6.0, 22.0, 1.5, 8.0
"""Gains, all in 1/s."""
RATE_LIMIT_RADPS, INTEGRAL_LIMIT_RAD, YAW_LIMIT = np.radians(360.0), 0.5, 0.15
"""YAW_LIMIT: torque about z at most, as a share of the collective thrust times the moment of a rotor."""
IDLE = 0.05
"""Least command of a rotor in flight."""


class Cascade:
    """The controllers of all runs."""

    def __init__(self, frame: Airframe, runs: int, period_s: float) -> None:
        self._frame, self._period_s = frame, period_s
        self._inverse = np.linalg.inv(frame.allocation())
        self._inertia = np.array(frame.inertia_kgm2)[:, None]
        self._gain = np.array([RATE_GAIN, RATE_GAIN, YAW_GAIN])[:, None]
        self._sum_rad = np.zeros((3, runs))

    def command(
        self, up: FloatArray, wanted: FloatArray, yaw_radps: FloatArray, rate_radps: FloatArray, thrust_n: FloatArray,
        flying: BoolArray,
    ) -> FloatArray:  # fmt: skip
        """Commands of the rotors, 0 to 1, (4, runs). up: estimated vertical, wanted: setpoint of it, body axes, (3,
        runs); thrust_n: collective, (runs,); flying: the vehicle is off the ground; else the integral does not
        change."""
        asked = ATTITUDE_GAIN * cross(wanted, up) + yaw_radps * up
        error = np.clip(asked, -RATE_LIMIT_RADPS, RATE_LIMIT_RADPS) - rate_radps
        self._sum_rad += np.where(flying, error * self._period_s, 0.0)
        np.clip(self._sum_rad, -INTEGRAL_LIMIT_RAD, INTEGRAL_LIMIT_RAD, out=self._sum_rad)
        torque = self._inertia * self._gain * (error + RATE_INTEGRAL * self._sum_rad)
        most = YAW_LIMIT * thrust_n * self._frame.moment_m
        torque[2] = np.clip(torque[2], -most, most)
        by_each = self._inverse[:, :, None] * np.vstack([thrust_n, torque])
        shares = total(np.swapaxes(by_each, 0, 1)) / (self._frame.thrust_max_n / 4.0)
        shares -= np.maximum(shares.max(axis=0) - 1.0, 0.0)
        shares += np.maximum(-shares.min(axis=0), 0.0)
        return np.maximum(command_for(shares), IDLE)

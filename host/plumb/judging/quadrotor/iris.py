"""A second frame for `quadrotor`: PX4's iris, twice as heavy, reported beside the hummingbird.

Its gains are worked out as the hummingbird's: errors of the rates decay as fast, over the angular acceleration that a
full command makes in a hover. All numbers are those of `plumb.physics.airframe`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.physics.airframe import IRIS_X, THRUST_LINEAR, THRUST_SQUARE, Airframe
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.tuning import QuadrotorTuning

NAME = "iris"


def accelerations_radps2(frame: Airframe) -> tuple[float, float, float]:
    """About x, y, z, by a command of 1, in a hover."""
    per_rotor_n = frame.thrust_max_n / 4.0 * (2.0 * THRUST_SQUARE * frame.hover_command + THRUST_LINEAR)
    x, y, z = np.abs(frame.allocation()[1:]).sum(axis=1) * per_rotor_n / np.array(frame.inertia_kgm2)
    return float(x), float(y), float(z)


def tuning() -> QuadrotorTuning:
    """The shipped one with gains and drag of this frame."""
    shipped, (x, y, z) = quadrotor.HUMMINGBIRD, accelerations_radps2(IRIS_X)
    aid = replace(shipped.attitude.aid, drag_per_s=IRIS_X.drag_told_per_s, hover=IRIS_X.hover_command)
    rates = replace(
        shipped.rates,
        roll=quadrotor.gains(quadrotor.RATE_PER_S, x, quadrotor.LEAD_S),
        pitch=quadrotor.gains(quadrotor.RATE_PER_S, y, quadrotor.LEAD_S),
        yaw=quadrotor.gains(quadrotor.YAW_PER_S, z),
    )
    return replace(shipped, rates=rates, attitude=replace(shipped.attitude, aid=aid))

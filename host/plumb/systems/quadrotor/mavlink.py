"""`quadrotor` on a ground station: its attitude, whose heading is the gyro's alone, and the sticks of its receiver."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.systems.mavlink import Attitude, Values, of_quaternion, sticks

VEHICLE = "QUADROTOR"
ATTITUDE = ("w", "x", "y", "z")
FRAMES = (*(f"QUADROTOR_ROTOR_{rotor}" for rotor in range(4)), "RAW_C", "RAW_D")


def attitude(values: Values, /) -> Attitude | None:
    return of_quaternion(values, ATTITUDE)


def channels(setpoint: int | None, commands: Mapping[str, int], /) -> tuple[float, ...]:
    return sticks(setpoint, commands)

"""`quadrotor` on a ground station: its attitude, whose heading is the gyro's alone, and the sticks of its receiver."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.systems.mavlink import HALF_US, LOW_US, MIDDLE_US, SPAN_US, Attitude, Values, of_quaternion

VEHICLE = "QUADROTOR"
ATTITUDE = ("attitude_w", "attitude_x", "attitude_y", "attitude_z")
FRAMES = (*(f"QUADROTOR_ROTOR_{rotor}" for rotor in range(4)), "RAW_C", "RAW_D")
FULL = 32767.0


def attitude(values: Values, /) -> Attitude | None:
    return of_quaternion(values, ATTITUDE)


def channels(setpoint: int | None, commands: Mapping[str, int], /) -> tuple[float, ...]:
    if setpoint is None or not commands:
        return ()
    roll, pitch, yaw = (commands[name] / FULL for name in ("roll", "pitch", "yaw"))
    throttle = LOW_US + SPAN_US * max(setpoint, 0) / FULL
    switches = [LOW_US + SPAN_US * (commands["switches"] >> bit & 1) for bit in range(2)]
    return MIDDLE_US + HALF_US * roll, MIDDLE_US + HALF_US * pitch, throttle, MIDDLE_US - HALF_US * yaw, *switches

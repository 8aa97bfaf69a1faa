"""`attitude` on a ground station: a body, whose heading is the gyro's alone."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.systems.mavlink import Attitude, Values, of_quaternion

VEHICLE = "GENERIC"
FRAMES: tuple[str, ...] = ()


def attitude(values: Values, /) -> Attitude | None:
    return of_quaternion(values, ("w", "x", "y", "z"))


def channels(_setpoint: int | None, _commands: Mapping[str, int], /) -> tuple[float, ...]:
    return ()

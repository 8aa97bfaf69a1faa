"""`balancer` on a ground station: its lean is pitch; roll and yaw are 0."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.systems.mavlink import Attitude, Values, of_tilt

VEHICLE = "GROUND_ROVER"
FRAMES: tuple[str, ...] = ()


def attitude(values: Values, /) -> Attitude | None:
    return of_tilt(values)


def channels(_setpoint: int | None, _commands: Mapping[str, int], /) -> tuple[float, ...]:
    return ()

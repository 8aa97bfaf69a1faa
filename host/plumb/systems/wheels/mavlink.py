"""`wheels` on a ground station: its lean is pitch, its turn rate the rate of yaw; roll and yaw are 0; the sticks of its
receiver."""

from __future__ import annotations

import math
from collections.abc import Mapping

from plumb.systems.mavlink import UNKNOWN, Attitude, Values, of_tilt, sticks

VEHICLE = "GROUND_ROVER"
FRAMES = ("WHEELS_DRIVE", "WHEELS_TURN", "WHEELS_ANGLE", "RAW_D", "RAW_E")


def attitude(values: Values, /) -> Attitude | None:
    turn_dps = values.get("turn_rate_dps")
    return of_tilt(values, yawspeed_radps=UNKNOWN if turn_dps is None else -math.radians(turn_dps))


def channels(setpoint: int | None, commands: Mapping[str, int], /) -> tuple[float, ...]:
    return sticks(setpoint, commands)

"""`balancer` on a ground station: its lean is pitch; roll and yaw are 0."""

from __future__ import annotations

import math
from collections.abc import Mapping

from plumb.systems.mavlink import UNKNOWN, Attitude, Values

VEHICLE = "GROUND_ROVER"
FRAMES: tuple[str, ...] = ()


def attitude(values: Values, /) -> Attitude | None:
    tilt, rate_dps = values.get("tilt_deg"), values.get("rate_dps")
    rate = UNKNOWN if rate_dps is None else math.radians(rate_dps)
    return None if tilt is None else Attitude(0.0, -math.radians(tilt), 0.0, pitchspeed_radps=-rate)


def channels(_setpoint: int | None, _commands: Mapping[str, int], /) -> tuple[float, ...]:
    return ()

"""Contract of mavlink.py: a system that a ground station shows (`plumb bridge --mavlink`).

Angles and rates are MAVLink's: body axes x to the front, y to the right, z down, earth axes north, east, down; a
positive roll lowers the right side, a positive pitch lifts the nose, a positive yaw turns to the right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol

from plumb.spec.system_parts import Part

Values = Mapping[str, float | None]
"""Columns of the telemetry; None: not received at present."""
UNKNOWN = math.nan
MIDDLE_US, HALF_US, LOW_US, SPAN_US = 1500.0, 500.0, 1000.0, 1000.0
"""Of a channel of a radio receiver."""
FULL = 32767.0
"""Of a stick among the commands of a step."""


class Attitude(NamedTuple):
    """In rad and rad/s; UNKNOWN for a rate that is not received."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    rollspeed_radps: float = UNKNOWN
    pitchspeed_radps: float = UNKNOWN
    yawspeed_radps: float = UNKNOWN


class MavlinkVehicle(Protocol):
    """mavlink.py of a system."""

    @property
    def VEHICLE(self) -> str:
        """Its MAV_TYPE, without the prefix."""

    @property
    def FRAMES(self) -> tuple[str, ...]:
        """Frames with what the other two take, for a run that is begun for a ground station; () for those of `plumb
        monitor`."""

    def attitude(self, values: Values, /) -> Attitude | None:
        """From the newest telemetry; None while it says nothing of the attitude."""

    def channels(self, setpoint: int | None, commands: Mapping[str, int], /) -> tuple[float, ...]:
        """Channels of the receiver in us, from the inputs that the newest step used; () for a system without pilot."""


MAVLINK = Part[MavlinkVehicle]("mavlink", MavlinkVehicle, without="a ground station has no picture of it")


def of_tilt(values: Values, *, yawspeed_radps: float = UNKNOWN) -> Attitude | None:
    """From the columns of a vehicle that leans about its axle, forward positive: its lean is pitch; roll and yaw are
    0."""
    tilt, rate_dps = values.get("tilt_deg"), values.get("rate_dps")
    rate = UNKNOWN if rate_dps is None else math.radians(rate_dps)
    if tilt is None:
        return None
    return Attitude(0.0, -math.radians(tilt), 0.0, pitchspeed_radps=-rate, yawspeed_radps=yawspeed_radps)


def sticks(setpoint: int | None, commands: Mapping[str, int]) -> tuple[float, ...]:
    """Channels of a system whose receiver gives a throttle as setpoint, and roll, pitch, yaw and switches as commands;
    () while one of them is not known."""
    if setpoint is None or not commands:
        return ()
    roll, pitch, yaw = (commands[name] / FULL for name in ("roll", "pitch", "yaw"))
    throttle = LOW_US + SPAN_US * max(setpoint, 0) / FULL
    switches = [LOW_US + SPAN_US * (commands["switches"] >> bit & 1) for bit in range(2)]
    return MIDDLE_US + HALF_US * roll, MIDDLE_US + HALF_US * pitch, throttle, MIDDLE_US - HALF_US * yaw, *switches


def of_quaternion(values: Values, names: tuple[str, str, str, str]) -> Attitude | None:
    """From the columns of a quaternion, body to earth with x to the front, y to the left, z up, and those of the
    rates, where they are received."""
    parts = [value for name in names if (value := values.get(name)) is not None]
    if len(parts) < len(names):
        return None
    w, x, y, z = parts
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    rates = [values.get(f"rate_{axis}_dps") for axis in "xyz"]
    p, q, r = (UNKNOWN if rate is None else math.radians(rate) for rate in rates)
    return Attitude(roll, -pitch, -yaw, p, -q, -r)

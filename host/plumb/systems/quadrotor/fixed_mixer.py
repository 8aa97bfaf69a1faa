"""The rates that sticks and the error of the vertical demand of `quadrotor`, and the mixer of an X frame, in integers.

The functions have the names of firmware/systems/quadrotor_mixer.c, without plumb_quadrotor_.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, mulhi_i32

FULL_Q24, ONE_Q28, UPTURNED_Q28, ERROR_MAX_Q28 = 1 << 24, 1 << 28, 1 << 22, 1 << 29
"""UPTURNED: one plus the cosine of 170 deg."""


class Mixed(NamedTuple):
    """thrust: mean command of the rotors; excess: what roll, pitch and yaw did not get; conditions of the flags."""

    rotors: list[int]
    pulses: list[int]
    thrust: int
    excess: list[int]
    tilt_limited: bool = False
    yaw_limited: bool = False
    thrust_moved: bool = False


def by_stick(stick_q15: int, full: int) -> int:
    """Demand of a stick: its position, Q15, times the demand at full deflection."""
    return 2 * mulhi_i32(stick_q15 << 16, full)


def lean_error(up: Sequence[int], wx: int, wy: int) -> list[int]:
    """Error of the vertical about each axis, Q28: the cross product of wanted and estimated; beyond a right angle, the
    tangent of half the angle."""
    s = 4 * (mulhi_i32(wx, wx) + mulhi_i32(wy, wy))
    s2 = mulhi_i32(s, s)
    s3 = mulhi_i32(4 * s2, s)
    wz = 4 * (ONE_Q28 - (s >> 3) - (s2 >> 3) - (s3 >> 4))
    ux, uy, uz = up
    ex = mulhi_i32(wy, uz) - mulhi_i32(wz, uy)
    ey = mulhi_i32(wz, ux) - mulhi_i32(wx, uz)
    ez = mulhi_i32(wx, uy) - mulhi_i32(wy, ux)
    n = ONE_Q28 + mulhi_i32(wx, ux) + mulhi_i32(wy, uy) + mulhi_i32(wz, uz)
    if n < UPTURNED_Q28:
        return [ERROR_MAX_Q28, 0, 0]
    if n < ONE_Q28:
        k = 0xFFFFFFFF // (n >> 10)
        return [clamp((e * k) >> 14, -ERROR_MAX_Q28, ERROR_MAX_Q28) for e in (ex, ey, ez)]
    return [ex, ey, ez]


def ask(
    p: Params, up: Sequence[int], sticks: Sequence[int], levels: bool, rate_max_q28: int
) -> tuple[list[int], list[int]]:
    """The error of the vertical, and the rates that the sticks of roll, pitch and yaw demand. levels: roll and pitch
    demand an angle, whose error asks for at most rate_max."""
    roll, pitch, yaw = sticks
    yaw_rate, most = by_stick(yaw, p["quadrotor.yaw_rate_max_q28"]), rate_max_q28 >> 4
    if not levels:
        full = p["quadrotor.stick_rate_q28"]
        return [0, 0, 0], [by_stick(roll, full), by_stick(pitch, full), yaw_rate]
    tilt_max = p["quadrotor.tilt_max_q30"]
    error = lean_error(up, -by_stick(pitch, tilt_max), by_stick(roll, tilt_max))
    asked = [
        16 * clamp(mulhi_i32(e, p["quadrotor.tilt_gain_q28"]), -most, most) + 4 * mulhi_i32(yaw_rate, part)
        for e, part in zip(error, up, strict=True)
    ]
    return error, asked


def mix(p: Params, throttle_q15: int, demand: Sequence[int], free: bool) -> Mixed:
    """The four commands of flying rotors: roll and pitch come first, together; yaw gets what they leave; the thrust
    gives way to all three. free: the thrust may rise above the throttle."""
    idle, thrust = p["quadrotor.idle_q24"], throttle_q15 << 9
    whole = (FULL_Q24 - idle) >> 1
    half = whole if free else clamp(thrust - idle, 0, whole)

    r, q = clamp(demand[0], -FULL_Q24, FULL_Q24), clamp(demand[1], -FULL_Q24, FULL_Q24)
    total = abs(r) + abs(q)
    tilt_limited = total > half
    if tilt_limited:
        share = (half << 8) // ((total >> 7) + 1)
        r, q = (r * share) >> 15, (q * share) >> 15
    a, b = abs(r), abs(q)
    most = clamp(half - (max(a, b) if free else a + b), 0, p["quadrotor.yaw_max_q24"])
    y = clamp(demand[2], -most, most)

    m = [y - r - q, r - q - y, r + q + y, q - r - y]
    moved = min(max(thrust, idle - min(m)), FULL_Q24 - max(m))
    rotors = [clamp(moved + one, idle, FULL_Q24) for one in m]
    return Mixed(
        rotors,
        [pulse(p, rotor) for rotor in rotors],
        moved,
        [demand[0] - r, demand[1] - q, demand[2] - y],
        tilt_limited,
        yaw_limited=y != demand[2],
        thrust_moved=moved != thrust,
    )


def pulse(p: Params, rotor_q24: int) -> int:
    """Of a rotor's speed controller, half-microseconds."""
    longer = ((rotor_q24 >> 8) * p["esc.span_halfus"] + (1 << 15)) >> 16
    return clamp(p["esc.mid_halfus"] + longer, p["esc.min_halfus"], p["esc.max_halfus"])


def rest(p: Params) -> Mixed:
    """The commands of stopped rotors."""
    return Mixed([0] * 4, [p["esc.neutral_halfus"]] * 4, 0, [0] * 3)

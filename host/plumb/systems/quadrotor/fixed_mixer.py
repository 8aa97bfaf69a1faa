"""From the demands of `quadrotor` to its four rotors, in integers.

The functions have the names of docs/reference/arithmetic/quadrotor.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, select

FULL_Q24 = 1 << 24


class Mixed(NamedTuple):
    """thrust: mean command of the rotors; excess: what roll, pitch and yaw did not get; conditions of the flags."""

    rotors: list[Integer]
    pulses: list[Integer]
    thrust: Integer
    excess: list[Integer]
    tilt_limited: Integer
    yaw_limited: Integer
    thrust_moved: Integer


def smaller(a: Integer, b: Integer) -> Integer:
    return select(a < b, a, b)


def larger(a: Integer, b: Integer) -> Integer:
    return select(a > b, a, b)


def mix(p: Params, flies: Integer, may_fly: Integer, throttle: Integer, demand: Sequence[Integer]) -> Mixed:
    """Roll and pitch come first, together; yaw gets what they leave; the thrust gives way to all three."""
    idle = p["quadrotor.idle_q24"]
    free = (p["quadrotor.airmode"] == 1) & may_fly
    asked = throttle << 9
    half = (FULL_Q24 - idle) >> 1
    half = select(free, half, clamp(asked - idle, 0, half))

    r, q = (clamp(one, -FULL_Q24, FULL_Q24) for one in demand[:2])
    total = abs(r) + abs(q)
    tilt_limited = total > half
    share = (half << 8) // ((total >> 7) + 1)
    r, q = (select(tilt_limited, (one * share) >> 15, one) for one in (r, q))
    left = half - select(free, larger(abs(r), abs(q)), abs(r) + abs(q))
    most = clamp(left, 0, p["quadrotor.yaw_max_q24"])
    y = clamp(demand[2], -most, most)

    m = [y - r - q, r - q - y, r + q + y, q - r - y]
    thrust = smaller(larger(asked, idle - reduce(smaller, m)), FULL_Q24 - reduce(larger, m))
    rotors = [clamp(thrust + one, idle, FULL_Q24) for one in m]
    return Mixed(
        rotors=[select(flies, rotor, 0 * rotor) for rotor in rotors],
        pulses=[select(flies, pulse(p, rotor), p["esc.neutral_halfus"]) for rotor in rotors],
        thrust=select(flies, thrust, 0 * thrust),
        excess=[select(flies, one - got, 0 * got) for one, got in zip(demand, (r, q, y), strict=True)],
        tilt_limited=flies & tilt_limited,
        yaw_limited=flies & (demand[2] != y),
        thrust_moved=flies & (thrust != asked),
    )


def pulse(p: Params, rotor: Integer) -> Integer:
    """Of a rotor's speed controller, half-microseconds."""
    d = ((rotor >> 8) * p["esc.span_halfus"] + (1 << 15)) >> 16
    return clamp(p["esc.mid_halfus"] + d, p["esc.min_halfus"], p["esc.max_halfus"])

"""Turns of the attitude of `attitude` in integers, and its matrix.

The functions have the names of docs/reference/arithmetic/attitude.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.fixed.trig import length, reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, mul, select, wrap_i32
from plumb.systems.attitude.fixed_state import ControlState

I32 = (1 << 31) - 1
SIXTH_Q32 = 715827883


def turn_body(c: ControlState, h: Sequence[Integer]) -> Integer:
    """Turn the attitude by these half angles; returns the sum of their squares."""
    s = (mul(h[0], h[0]) + mul(h[1], h[1]) + mul(h[2], h[2])) >> 2
    inner = 4 * mul(s, ONE_Q30 - mul(s, 102261126))
    missing = 4 * mul(4 * mul(s, ONE_Q30 - mul(inner, 214748365)), SIXTH_Q32)
    inner = 4 * mul(s, ONE_Q30 - mul(s, 143165577))
    cosine = -8 * mul(s, ONE_Q30 - mul(inner, 357913941))
    x, y, z = (angle - mul(angle, missing) for angle in h)
    w, qx, qy, qz = c.attitude
    c.attitude = [
        w + mul(w, cosine) - mul(qx, x) - mul(qy, y) - mul(qz, z),
        qx + mul(qx, cosine) + mul(w, x) + mul(qy, z) - mul(qz, y),
        qy + mul(qy, cosine) + mul(w, y) + mul(qz, x) - mul(qx, z),
        qz + mul(qz, cosine) + mul(w, z) + mul(qx, y) - mul(qy, x),
    ]
    return s


def matrix(q: Sequence[Integer]) -> list[list[Integer]]:
    w, x, y, z = q
    xx, yy, zz = mul(x, x), mul(y, y), mul(z, z)
    xy, xz, yz = mul(x, y), mul(x, z), mul(y, z)
    wx, wy, wz = mul(w, x), mul(w, y), mul(w, z)
    rows = [
        [ONE_Q30 - 8 * (yy + zz), 8 * (xy - wz), 8 * (xz + wy)],
        [8 * (xy + wz), ONE_Q30 - 8 * (xx + zz), 8 * (yz - wx)],
        [8 * (xz - wy), 8 * (yz + wx), ONE_Q30 - 8 * (xx + yy)],
    ]
    return [[wrap_i32(entry) for entry in row] for row in rows]


def turn_earth(q: Sequence[Integer], w: Integer, x: Integer, y: Integer) -> list[Integer]:
    qw, qx, qy, qz = q
    turned = [
        4 * (mul(w, qw) - mul(x, qx) - mul(y, qy)),
        4 * (mul(w, qx) + mul(x, qw) + mul(y, qz)),
        4 * (mul(w, qy) + mul(y, qw) - mul(x, qz)),
        4 * (mul(w, qz) + mul(x, qy) - mul(y, qx)),
    ]
    squares = [mul(one, one) for one in turned]
    longer = 8 * ((1 << 28) - squares[0] - squares[1] - squares[2] - squares[3])
    return [one + mul(one, longer) for one in turned]


def align(c: ControlState, x: Integer, y: Integer, z: Integer, least: int) -> Integer:
    """Turn the earth so that the vector points up; returns half its length, below `least` nothing is turned."""
    half = 2 * length(length(y, x), z >> 1)
    w, qx, qy = half + (z >> 1), y >> 1, -(x >> 1)
    long = 4 * length(length(qy, qx), w >> 1)
    over = long < half >> 8
    divisor = clamp(long, 1, I32)
    n = clz32(divisor)
    v = reciprocal((divisor << n) >> 1)
    w, qx, qy = ((one * v) >> (32 - n) for one in (w, qx, qy))
    turned = turn_earth(c.attitude, select(over, 0, w), select(over, ONE_Q30, qx), select(over, 0, qy))
    c.attitude = [select(half >= least, new, old) for new, old in zip(turned, c.attitude, strict=True)]
    return half

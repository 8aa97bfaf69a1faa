"""How the quaternion of `attitude` turns in integers: about the earth's axes, about the body's, to the vertical.

The functions have the names of firmware/systems/attitude_turns.c, without plumb_attitude_.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.fixed.trig import length, reciprocal
from plumb.kernels.integers import clz32, mulhi_i32, wrap_i32
from plumb.systems.attitude.fixed_state import SIXTH_Q32

TWELFTH_Q32, TWENTIETH_Q32, THIRTIETH_Q32, FORTY_SECOND_Q32 = 357913941, 214748365, 143165577, 102261126


def turn_earth(q: list[int], w: int, x: int, y: int) -> None:
    """Turn the earth's side of the attitude: (w, x, y, 0) * q, then a first-order normalisation."""
    qw = 4 * (mulhi_i32(w, q[0]) - mulhi_i32(x, q[1]) - mulhi_i32(y, q[2]))
    qx = 4 * (mulhi_i32(w, q[1]) + mulhi_i32(x, q[0]) + mulhi_i32(y, q[3]))
    qy = 4 * (mulhi_i32(w, q[2]) + mulhi_i32(y, q[0]) - mulhi_i32(x, q[3]))
    qz = 4 * (mulhi_i32(w, q[3]) + mulhi_i32(x, q[2]) - mulhi_i32(y, q[1]))
    square_q28 = mulhi_i32(qw, qw) + mulhi_i32(qx, qx) + mulhi_i32(qy, qy) + mulhi_i32(qz, qz)
    longer_q32 = ((1 << 28) - square_q28) * 8

    q[0] = qw + mulhi_i32(qw, longer_q32)
    q[1] = qx + mulhi_i32(qx, longer_q32)
    q[2] = qy + mulhi_i32(qy, longer_q32)
    q[3] = qz + mulhi_i32(qz, longer_q32)


def align(q: list[int], x: int, y: int, z: int, least: int) -> int:
    """Turn the attitude so that the vector, in earth axes, points up; returns half its length, below `least` nothing is
    turned."""
    half = length(length(y, x), z >> 1) << 1
    if half < least:
        return half

    w, qx, qy = half + (z >> 1), y >> 1, -(x >> 1)
    long = length(length(qy, qx), w >> 1) << 2
    if long < half >> 8:
        turn_earth(q, 0, ONE_Q30, 0)
        return half
    n = clz32(long)
    inverse = reciprocal((long << n) >> 1)
    turn_earth(q, (w * inverse) >> (32 - n), (qx * inverse) >> (32 - n), (qy * inverse) >> (32 - n))
    return half


def turn_force(force: list[int], x_q32: int, y_q32: int) -> None:
    """Turn an acceleration in earth axes by the small angle of a correction of the attitude."""
    fx, fy, fz = force
    force[0] = wrap_i32(fx + mulhi_i32(y_q32, fz))
    force[1] = wrap_i32(fy - mulhi_i32(x_q32, fz))
    force[2] = wrap_i32(fz + mulhi_i32(x_q32, fy) - mulhi_i32(y_q32, fx))


def turn_body(q: list[int], hx: int, hy: int, hz: int) -> int:
    """Turn the attitude by half angles about body axes; returns their square, Q30."""
    s = (mulhi_i32(hx, hx) + mulhi_i32(hy, hy) + mulhi_i32(hz, hz)) >> 2
    sine = ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, FORTY_SECOND_Q32)), TWENTIETH_Q32)
    missing_q32 = 4 * mulhi_i32(4 * mulhi_i32(s, sine), SIXTH_Q32)
    cosine = ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, THIRTIETH_Q32)), TWELFTH_Q32)
    c = -8 * mulhi_i32(s, cosine)
    x = hx - mulhi_i32(hx, missing_q32)
    y = hy - mulhi_i32(hy, missing_q32)
    z = hz - mulhi_i32(hz, missing_q32)
    qw, qx, qy, qz = q
    q[0] = qw + mulhi_i32(qw, c) - mulhi_i32(qx, x) - mulhi_i32(qy, y) - mulhi_i32(qz, z)
    q[1] = qx + mulhi_i32(qx, c) + mulhi_i32(qw, x) + mulhi_i32(qy, z) - mulhi_i32(qz, y)
    q[2] = qy + mulhi_i32(qy, c) + mulhi_i32(qw, y) + mulhi_i32(qz, x) - mulhi_i32(qx, z)
    q[3] = qz + mulhi_i32(qz, c) + mulhi_i32(qw, z) + mulhi_i32(qx, y) - mulhi_i32(qy, x)
    return s


def matrix_of(q: Sequence[int]) -> list[list[int]]:
    """Rows of the attitude's matrix, Q30: from body to earth."""
    w, x, y, z = q
    xx, yy, zz = mulhi_i32(x, x), mulhi_i32(y, y), mulhi_i32(z, z)
    xy, xz, yz = mulhi_i32(x, y), mulhi_i32(x, z), mulhi_i32(y, z)
    wx, wy, wz = mulhi_i32(w, x), mulhi_i32(w, y), mulhi_i32(w, z)
    return [
        [wrap_i32(ONE_Q30 - 8 * (yy + zz)), wrap_i32(8 * (xy - wz)), wrap_i32(8 * (xz + wy))],
        [wrap_i32(8 * (xy + wz)), wrap_i32(ONE_Q30 - 8 * (xx + zz)), wrap_i32(8 * (yz - wx))],
        [wrap_i32(8 * (xz - wy)), wrap_i32(8 * (yz + wx)), wrap_i32(ONE_Q30 - 8 * (xx + yy))],
    ]

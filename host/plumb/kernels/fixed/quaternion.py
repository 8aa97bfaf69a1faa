"""Quaternions in integers, Q30: product, rotation and difference (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.integers import INT32_MAX, INT32_MIN, clamp, wrap_i32

ONE_Q30 = 1 << 30
PI_Q29, INVERSE_PI_Q32 = 1686629713, 1367130551


def mul_q30(a: int, b: int) -> int:
    """a * b / 2^30 of two signed 32-bit values, rounded to nearest."""
    assert INT32_MIN <= a <= INT32_MAX and INT32_MIN <= b <= INT32_MAX, (a, b)
    return wrap_i32((a * b + (1 << 29)) >> 30)


Quaternion = tuple[int, int, int, int]


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """p * q, Q30."""
    (pw, px, py, pz), (qw, qx, qy, qz) = p, q
    half = 1 << 29
    return (
        (pw * qw - px * qx - py * qy - pz * qz + half) >> 30,
        (pw * qx + px * qw + py * qz - pz * qy + half) >> 30,
        (pw * qy - px * qz + py * qw + pz * qx + half) >> 30,
        (pw * qz + px * qy - py * qx + pz * qw + half) >> 30,
    )


def rotate(q: Quaternion, turn_q60: Sequence[int]) -> Quaternion:
    """q after the body rotates by a rotation vector (turn Q60), renormalised."""
    half, square = [], 0
    for turn in turn_q60:
        turn_q32 = (clamp(turn, -(1 << 57), 1 << 57) + (1 << 27)) >> 28
        half.append((turn_q32 * PI_Q29 + (1 << 30)) >> 31)
        square = square + mul_q30(half[-1], half[-1])
    fourth = mul_q30(square, square)
    sixth = mul_q30(fourth, square)
    cosine = ONE_Q30 - square // 2 + fourth // 24 - sixth // 720
    sinc = ONE_Q30 - square // 6 + fourth // 120
    x, y, z = (mul_q30(h, sinc) for h in half)
    r = product(q, (cosine, x, y, z))
    length = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]
    keep = ((3 << 60) - length) >> 31
    return (mul_q30(r[0], keep), mul_q30(r[1], keep), mul_q30(r[2], keep), mul_q30(r[3], keep))


def difference(start: Quaternion, end: Quaternion) -> list[int]:
    """Rotation vector from `start` to `end` in the body's axes, turn Q32, for small angles."""
    w, *vector = product((start[0], -start[1], -start[2], -start[3]), end)
    turns = [(v * INVERSE_PI_Q32 + (1 << 29)) >> 30 for v in vector]
    return [-turn for turn in turns] if w < 0 else turns

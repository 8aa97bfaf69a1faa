"""Covariance of `attitude` in integers: its growth and its measurements."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.trig import reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, mul, select, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_state import CELL, STATES, TILT, ControlState

AXES, HORIZONTAL, COUPLED = range(3), range(2), range(6)
VARIANCE_MAX_Q32 = 858993459
INNOVATION_MAX_Q28 = (1 << 28) - 1
GAIN_MAX_Q28 = (1 << 31) - 1
VELOCITY_Q28 = 1 << 30
GATE = 25


def near(a: Integer, b: Integer) -> Integer:
    return (a * b + (1 << 31)) >> 32


def near16(a: Integer, b: Integer) -> Integer:
    return wrap_i32(16 * near(a, b))


def weighted(weights: Sequence[Integer], values: Sequence[Integer]) -> Integer:
    return sum(near(weight, value) for weight, value in zip(weights, values[:6], strict=True))


def sat32(x: Integer) -> Integer:
    return clamp(x, -(1 << 31), (1 << 31) - 1)


def cov(c: ControlState, i: int, j: int) -> Integer:
    return c.covariance[CELL[i][j]]


def add(c: ControlState, i: int, j: int, value: Integer) -> None:
    """Add to P(i, j), modulo 2^32."""
    c.covariance[CELL[i][j]] = wrap_i32(c.covariance[CELL[i][j]] + value)


def grow_velocity(c: ControlState, p: Params) -> None:
    lever = c.half_lever
    for i in COUPLED:
        add(c, 8, i, near(lever, cov(c, 7, i)))
        add(c, 9, i, -near(lever, cov(c, 6, i)))
    u, v, t = cov(c, 8, 7), cov(c, 9, 6), cov(c, 9, 7)
    add(c, 8, 6, near(lever, cov(c, 7, 6)))
    add(c, 8, 7, near(lever, cov(c, 7, 7)))
    add(c, 9, 6, -near(lever, cov(c, 6, 6)))
    add(c, 9, 7, -near(lever, cov(c, 7, 6)))
    add(c, 8, 8, near(lever, wrap_i32(u + cov(c, 8, 7))))
    add(c, 9, 8, near(lever, t) - near(lever, cov(c, 8, 6)))
    add(c, 9, 9, -near(lever, wrap_i32(v + cov(c, 9, 6))))


def grow_tilt(c: ControlState, p: Params, a: int) -> None:
    own, other, weights = TILT + a, TILT + 1 - a, c.coupling[6 * a : 6 * a + 6]
    old = [cov(c, own, i) for i in COUPLED]
    grown = [wrap_i32(old[i] + weighted(weights, [cov(c, i, j) for j in COUPLED])) for i in COUPLED]
    add(c, 7, 6, weighted(weights, [cov(c, other, j) for j in COUPLED]))
    for state in (8, 9):
        add(c, state, own, weighted(weights, [cov(c, state, j) for j in COUPLED]))
    add(c, own, own, weighted(weights, old) + weighted(weights, grown))
    for i in COUPLED:
        c.covariance[CELL[own][i]] = grown[i]


def weigh(c: ControlState, at: int, variance: Integer, measured: Integer, gated: bool) -> None:
    c.row = [cov(c, i, at) for i in STATES]
    exact = wrap_u32(c.row[at]) + variance
    coarse = select(exact >> 32 != 0, 4, 0 * variance)
    total = clamp(exact >> coarse, 1, (1 << 32) - 1)
    y = clamp(wrap_i32(measured - c.correction[at]), -INNOVATION_MAX_Q28, INNOVATION_MAX_Q28)
    n = clz32(total)
    one = 2 + coarse
    shift = clamp(n - one, 0, 32)
    v = reciprocal((total << n) >> 1) >> clamp(one - n, 0, 6)
    if gated:
        v = select((y * y) >> 24 > GATE * total, 0, v)
    limit = GAIN_MAX_Q28 >> shift
    c.gain = [clamp(mul(value, v), -limit, limit) << shift for value in c.row]
    c.correction = [wrap_i32(old + near16(one, y)) for old, one in zip(c.correction, c.gain, strict=True)]


def shrink(c: ControlState, p: Params) -> None:
    for i in STATES:
        for j in range(i + 1):
            add(c, i, j, -near16(c.gain[i], c.row[j]))

"""Covariance of `attitude` in integers: the slices that the steps of a block compute."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.trig import reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, select, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_state import (
    ACCELERATING,
    BIAS,
    CELL,
    JUDGED,
    REST,
    RESTARTED,
    STATES,
    TILT,
    UNSURE,
    VELOCITY,
    ControlState,
    in_runs,
    start,
)

AXES, HORIZONTAL, COUPLED = range(3), range(2), range(6)
VARIANCE_MAX_Q32 = 858993459
INNOVATION_MAX_Q28 = (1 << 28) - 1
GAIN_MAX_Q28 = (1 << 31) - 1
GATE = 25
VELOCITY_MAX_Q28, SPEED_MAX_Q26 = (1 << 30) - 1, (1 << 31) - 1
REST_SPEED_SQUARE_Q24, TRAVELS_Q24, HOLD_Q32 = 104857600, 16777, 1288490189
LAST_MOVING, LAST_RESTING = 8, 14


def mul(a: Integer, b: Integer) -> Integer:
    return (a * b) >> 32


def near(a: Integer, b: Integer) -> Integer:
    return (a * b + (1 << 31)) >> 32


def near16(a: Integer, b: Integer) -> Integer:
    return wrap_i32(16 * near(a, b))


def weighted(weights: Sequence[Integer], values: Sequence[Integer]) -> Integer:
    return sum(near(weight, value) for weight, value in zip(weights, values[:6], strict=True))


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


def grow_first(c: ControlState, p: Params) -> None:
    """The velocity of the block, then the growth of its covariance, or a new start."""
    judge(c, p)
    lost = c.lost != 0
    in_runs(c, p, c.lost == 0, grow_velocity)
    in_runs(c, p, lost, restart)


def grow(c: ControlState, p: Params) -> None:
    """Velocity once more, then the growth of every variance."""
    grow_velocity(c, p)
    bias = select(travels(c), 0, p["attitude.q_bias"])
    growths = [bias] * 3 + [p["attitude.q_scale"]] * 3 + [c.tilt_growth] * 2 + [c.velocity_growth] * 2
    for i, growth in enumerate(growths):
        add(c, i, i, select(cov(c, i, i) < VARIANCE_MAX_Q32, growth, 0))
    c.correction = [0 * c.slice for _ in STATES]


def judge(c: ControlState, p: Params) -> None:
    """What the block has shown of the velocity."""
    for i in HORIZONTAL:
        held = clamp(c.velocity[i], -VELOCITY_MAX_Q28, VELOCITY_MAX_Q28)
        c.velocity[i] = held - select(c.airborne == 1, 0, near(held, p["attitude.leak_q32"]))
    square = mul(c.velocity[0], c.velocity[0]) + mul(c.velocity[1], c.velocity[1])
    c.velocity_square = c.velocity_square + near(square - c.velocity_square, p["attitude.velocity_pass_q32"])
    remember_travel(c, p)
    least = p["attitude.speed_min"]
    moving = (c.velocity_square * p["attitude.velocity_share_q16"]) >> 14
    moving = moving + ((c.travel_excess * p["attitude.travel_gain_q16"]) >> 14)
    c.velocity_variance = select(c.airborne == 1, p["attitude.aid_variance"], clamp(least + moving, 0, SPEED_MAX_Q26))
    c.tilt_variance = wrap_u32(c.covariance[CELL[6][6]] + c.covariance[CELL[7][7]])
    unsure = select(c.tilt_variance > p["attitude.unsure"], UNSURE, 0)
    accelerating = select(c.velocity_variance > 4 * least, ACCELERATING, 0)
    c.block_flags = (c.block_flags & ~JUDGED) | unsure | accelerating
    too_fast = ((c.block_flags & REST) != 0) & (square > REST_SPEED_SQUARE_Q24)
    c.lost = c.lost | select(too_fast, 1, 0)


def travels(c: ControlState) -> Integer:
    """Whether a lasting velocity is explained by travel."""
    return c.travel_excess > TRAVELS_Q24


def travel_square(c: ControlState) -> Integer:
    """Square of the lasting velocity, g^2 s^2 Q24."""
    return mul(c.travel[0], c.travel[0]) + mul(c.travel[1], c.travel[1])


def remember_travel(c: ControlState, p: Params) -> None:
    """The lasting velocity, and its excess over what is expected; neither in flight."""
    for i in HORIZONTAL:
        lasting = c.travel[i] + near(c.velocity[i] - c.travel[i], p["attitude.travel_pass_q32"])
        c.travel[i] = select(c.airborne == 1, c.travel[i], lasting)
    explained = wrap_u32(c.covariance[CELL[8][8]] + c.covariance[CELL[9][9]])
    excess = travel_square(c) - (explained >> 6) - p["attitude.travel_least_q24"]
    kept = c.travel_excess - near(c.travel_excess, mul(p["attitude.travel_pass_q32"], HOLD_Q32)) - 1
    largest = select(excess > kept, excess, kept)
    c.travel_excess = select((largest > 0) & (c.airborne == 0), largest, 0 * kept)


def restart(c: ControlState, p: Params) -> None:
    start(c, p)
    c.block_flags = c.block_flags | RESTARTED


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


def weigh_velocity(c: ControlState, p: Params, i: int) -> None:
    weigh(c, VELOCITY + i, c.velocity_variance << 4, wrap_i32(c.measured[i] - c.velocity[i]) >> 1, gated=False)


def weigh_rest(c: ControlState, p: Params, i: int) -> None:
    mean_rate = clamp((c.half_mean[i] * p["attitude.rest_gain_q20"]) >> 20, -(1 << 31), (1 << 31) - 1)
    weigh(c, BIAS + i, p["attitude.rest_variance"], mean_rate, gated=True)


def shrink(c: ControlState, p: Params) -> None:
    for i in STATES:
        for j in range(i + 1):
            add(c, i, j, -near16(c.gain[i], c.row[j]))


MEASUREMENTS = [partial(weigh_velocity, i=i) for i in HORIZONTAL] + [partial(weigh_rest, i=i) for i in AXES]
SLICES: tuple[Callable[[ControlState, Params], None], ...] = (
    grow_first, partial(grow_tilt, a=0), partial(grow_tilt, a=1), grow,
    *(part for one in MEASUREMENTS for part in (one, shrink)),
)  # fmt: skip
"""Slices 1 to 14."""


def compute_slice(c: ControlState, p: Params) -> None:
    now = c.slice
    for number, part in enumerate(SLICES, 1):
        in_runs(c, p, now == number, part)
    last = select((c.block_flags & REST) != 0, LAST_RESTING, LAST_MOVING)
    c.slice = select((now == 0) | (now == last) | (c.slice != now), 0, now + 1)

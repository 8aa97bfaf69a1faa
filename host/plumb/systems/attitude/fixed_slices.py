"""What the steps of a block of `attitude` compute of the block before, in integers, a slice each.

The functions have the names of docs/reference/arithmetic/attitude.md.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_covariance import (
    AXES,
    HORIZONTAL,
    VARIANCE_MAX_Q32,
    VELOCITY_Q28,
    add,
    cov,
    grow_tilt,
    grow_velocity,
    near,
    sat32,
    shrink,
    weigh,
    weighted,
)
from plumb.systems.attitude.fixed_shock import held_still, lost_in_motion, reopen, travels
from plumb.systems.attitude.fixed_state import (
    ACCELERATING,
    BIAS,
    CELL,
    JUDGED,
    LANDED_BLOCKS,
    REST,
    RESTARTED,
    SCALE,
    STATES,
    TILT,
    UNSURE,
    VELOCITY,
    ControlState,
    in_runs,
    start,
)
from plumb.systems.attitude.fixed_turns import turn_earth

SPEED_MAX_Q26 = (1 << 31) - 1
REST_SPEED_SQUARE_Q24, HOLD_Q32, LASTING_MAX_Q24 = 104857600, 1288490189, 1 << 23
FLIGHT_LEAST_Q32 = 2943711
LEAST_REST_Q16, MOST_REST_Q16, TILTED_Q24, LONG_RESTS = 62300, 68853, 15099494, 7
CORRECTED_Q26 = 1 << 25
BIAS_MAX_Q32, SCALE_MAX_Q32, TURN_MAX_Q28 = 1 << 30, 1 << 28, 1 << 26
BIAS_UNIT_Q31 = 1367130551
LAST_MOVING, LAST_RESTING = 8, 14


def correct(c: ControlState, p: Params) -> None:
    """The corrections of the block before, propagated through the last one."""
    d = c.correction

    def carry() -> None:
        d[8] = wrap_i32(d[8] + near(c.half_lever, d[7]))
        d[9] = wrap_i32(d[9] - near(c.half_lever, d[6]))

    carry()
    for i in HORIZONTAL:
        d[6 + i] = wrap_i32(d[6 + i] + weighted(c.coupling[6 * i : 6 * i + 6], d))
    carry()
    for i in AXES:
        change = clamp((d[BIAS + i] * BIAS_UNIT_Q31 + (1 << 30)) >> 31, -BIAS_MAX_Q32, BIAS_MAX_Q32)
        c.bias[i] = clamp(c.bias[i] + change, -BIAS_MAX_Q32, BIAS_MAX_Q32)
        c.scale[i] = clamp(c.scale[i] + (d[SCALE + i] >> 2), -SCALE_MAX_Q32, SCALE_MAX_Q32)
    x, y = (clamp(d[TILT + i], -TURN_MAX_Q28, TURN_MAX_Q28) for i in HORIZONTAL)
    c.attitude = turn_earth(c.attitude, ONE_Q30, 2 * x, 2 * y)
    f, g, u = c.force_before
    c.force_before = [
        wrap_i32(f + mul(16 * y, u)),
        wrap_i32(g - mul(16 * x, u)),
        wrap_i32(u + mul(16 * x, g) - mul(16 * y, f)),
    ]
    for i in HORIZONTAL:
        c.velocity[i] = sat32(c.velocity[i] + 2 * d[VELOCITY + i])


def tilted_at_rest(c: ControlState, p: Params) -> Integer:
    """Whether an acceleration of 1 g lies well off the vertical."""
    mean = [wrap_i32(mul(part, p["attitude.inverse_block_q32"]) << 6) for part in c.force_before]
    total = wrap_u32(sum(mul(one, one) for one in mean))
    return (total > LEAST_REST_Q16) & (total < MOST_REST_Q16) & (mean[2] < TILTED_Q24)


def judge(c: ControlState, p: Params) -> None:
    """What the block has shown of the velocity; then the growth of its covariance begins, or a new start."""
    for i in HORIZONTAL:
        held = clamp(c.velocity[i], -VELOCITY_Q28, VELOCITY_Q28 - 1)
        c.velocity[i] = held - select(c.airborne == 1, 0, near(held, p["attitude.leak_q32"]))
    square = mul(c.velocity[0], c.velocity[0]) + mul(c.velocity[1], c.velocity[1])
    c.velocity_square = c.velocity_square + near(square - c.velocity_square, p["attitude.velocity_pass_q32"])
    remember_travel(c, p)
    remember_corrections(c, p)
    least = p["attitude.speed_min"]
    moving = c.velocity_square * p["attitude.velocity_share_q16"] + c.travel_excess * p["attitude.travel_gain_q16"]
    unknown = clamp(least + (moving >> 14), 0, SPEED_MAX_Q26)
    c.velocity_variance = select(c.airborne == 1, p["attitude.aid_variance"], unknown)
    c.tilt_variance = stated_variance(c, p)
    unsure = select(c.tilt_variance > p["attitude.unsure"], UNSURE, 0)
    accelerating = select(c.velocity_variance > 4 * least, ACCELERATING, 0)
    c.block_flags = (c.block_flags & ~JUDGED) | unsure | accelerating
    doubt(c, p, square)


def doubt(c: ControlState, p: Params, square: Integer) -> None:
    """The growth of the covariance begins; or a new start at rest; or the errors are unknown again."""
    up = mul(c.force_before[2], p["attitude.inverse_block_q32"])
    risen = c.rise + near((1 << 18) - up - c.rise, p["attitude.travel_pass_q32"])
    landed = c.carried_blocks == LANDED_BLOCKS
    c.rise = select(landed, risen, 0 * risen)
    long = (c.still_blocks == LONG_RESTS * p["attitude.rest_blocks"]) & (square > REST_SPEED_SQUARE_Q24)
    lost = landed & ((c.block_flags & REST) != 0) & (tilted_at_rest(c, p) | long)
    held = held_still(c, p)
    reopened = (lost == 0) & (held | lost_in_motion(c, p, travel_square(c)))
    c.block_flags = c.block_flags | select(reopened & held, REST, 0)
    in_runs(c, p, (lost | reopened) == 0, grow_velocity)
    in_runs(c, p, lost, restart)
    in_runs(c, p, reopened, reopen)


def travel_square(c: ControlState) -> Integer:
    """Square of the lasting velocity, g^2 s^2 Q24."""
    return mul(c.travel[0], c.travel[0]) + mul(c.travel[1], c.travel[1])


def remember_travel(c: ControlState, p: Params) -> None:
    """The velocity that lasts, in flight its difference from the measured one; and its excess, none in flight."""
    for i in HORIZONTAL:
        off = clamp(c.velocity[i] - c.measured[i], -VELOCITY_Q28, VELOCITY_Q28 - 1)
        c.travel[i] = c.travel[i] + near(off - c.travel[i], p["attitude.travel_pass_q32"])
    explained = wrap_u32(c.covariance[CELL[8][8]] + c.covariance[CELL[9][9]])
    excess = travel_square(c) - (explained >> 6) - p["attitude.travel_least_q24"]
    kept = c.travel_excess - near(c.travel_excess, mul(p["attitude.travel_pass_q32"], HOLD_Q32)) - 1
    largest = select(excess > kept, excess, kept)
    c.travel_excess = select((largest > 0) & (c.airborne == 0), largest, 0 * kept)


def remember_corrections(c: ControlState, p: Params) -> None:
    """The sum of the tilt's corrections, rad Q26, forgotten like a travel."""
    forgets = mul(p["attitude.travel_pass_q32"], HOLD_Q32)
    for i in HORIZONTAL:
        kept = c.corrected[i] - mul(c.corrected[i], forgets)
        c.corrected[i] = clamp(kept + (c.correction[TILT + i] >> 2), -CORRECTED_Q26, CORRECTED_Q26 - 1)


def stated_variance(c: ControlState, p: Params) -> Integer:
    """Of the tilt, rad^2 Q32: a share of the filter's, what was corrected in one direction, what keeps a velocity; in
    flight at least so much, what the newest difference of the velocities says, and at most an eighth less a block."""
    own = wrap_u32(c.covariance[CELL[6][6]] + c.covariance[CELL[7][7]])
    corrected = mul(c.corrected[0], c.corrected[0]) + mul(c.corrected[1], c.corrected[1])
    shown = select(corrected < own >> 10, corrected, own >> 10)
    lasting = travel_square(c)
    off = [clamp(c.velocity[i] - c.measured[i], -VELOCITY_Q28, VELOCITY_Q28 - 1) for i in HORIZONTAL]
    newest = mul(off[0], off[0]) + mul(off[1], off[1])
    told = (clamp(lasting, 0, LASTING_MAX_Q24) << 6) + (clamp(newest, 0, LASTING_MAX_Q24) << 5)
    now, kept = FLIGHT_LEAST_Q32 + 3 * (own >> 4) + told, c.tilt_variance - (c.tilt_variance >> 3)
    in_flight = (p["attitude.aid_s_q24"] != 0) & (c.carried_blocks != LANDED_BLOCKS)
    on_ground = wrap_u32(3 * ((own >> 4) + (shown << 11)) + (lasting >> 6))
    return select(in_flight, select(now > kept, now, kept), on_ground)


def restart(c: ControlState, p: Params) -> None:
    start(c, p)
    c.block_flags = c.block_flags | RESTARTED


def grow(c: ControlState, p: Params) -> None:
    """Velocity once more, then the growth of every variance."""
    grow_velocity(c, p)
    bias = select(travels(c), 0, p["attitude.q_bias"])
    growths = [bias] * 3 + [p["attitude.q_scale"]] * 3 + [c.tilt_growth] * 2 + [c.velocity_growth] * 2
    for i, growth in enumerate(growths):
        add(c, i, i, select(cov(c, i, i) < VARIANCE_MAX_Q32, growth, 0))
    c.correction = [0 * c.slice for _ in STATES]


def weigh_velocity(c: ControlState, p: Params, i: int) -> None:
    weigh(c, VELOCITY + i, c.velocity_variance << 4, wrap_i32(c.measured[i] - c.velocity[i]) >> 1, gated=False)


def weigh_rest(c: ControlState, p: Params, i: int) -> None:
    mean_rate = clamp((c.half_mean[i] * p["attitude.rest_gain_q20"]) >> 20, -(1 << 31), (1 << 31) - 1)
    weigh(c, BIAS + i, p["attitude.rest_variance"], mean_rate, gated=True)


def grow_and_weigh(c: ControlState, p: Params) -> None:
    """The end of the growth, and the first measurement."""
    grow(c, p)
    weigh_velocity(c, p, 0)


MEASUREMENTS: list[Callable[[ControlState, Params], None]] = [
    grow_and_weigh,
    partial(weigh_velocity, i=1),
    *(partial(weigh_rest, i=i) for i in AXES),
]
SLICES: tuple[Callable[[ControlState, Params], None], ...] = (
    correct, judge, partial(grow_tilt, a=0), partial(grow_tilt, a=1),
    *(part for one in MEASUREMENTS for part in (one, shrink)),
)  # fmt: skip
"""Slices 1 to 14."""


def compute_slice(c: ControlState, p: Params) -> None:
    now = c.slice
    for number, part in enumerate(SLICES, 1):
        in_runs(c, p, now == number, part)
    last = select((c.block_flags & REST) != 0, LAST_RESTING, LAST_MOVING)
    c.slice = select((now == 0) | (now == last) | (c.slice != now), 0, now + 1)

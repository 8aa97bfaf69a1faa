"""How `attitude` notices in integers that the bias of the gyro has stepped.

The functions have the names of docs/reference/arithmetic/attitude.md.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_covariance import HORIZONTAL, VARIANCE_MAX_Q32, near
from plumb.systems.attitude.fixed_state import CELL, LANDED_BLOCKS, ControlState, forget

RESTED = 5
RISE_MAX_Q18, RISE_LEAST_Q18, LEANS_SHIFT = 157286, 2621, 14
TRAVELS_Q24 = 16777


def note_turn(c: ControlState, p: Params) -> None:
    """How the block has turned about horizontal axes, and whether the gyro alone has turned."""
    up, by, turn = c.force_before[2], [], 0 * c.gap
    for i in HORIZONTAL:
        half = wrap_i32(c.turned_sum[3 * i] + c.turned_sum[3 * i + 1] + c.turned_sum[3 * i + 2])
        by.append(mul(wrap_i32(half << 5), up))
        turn = turn + (abs(half) >> 2)
    c.turning = c.turning + near(turn - c.turning, p["attitude.travel_pass_q32"] >> 1)
    x = wrap_i32(c.force_sum[0] - c.force_before[0] - by[1])
    y = wrap_i32(c.force_sum[1] - c.force_before[1] + by[0])
    stays = (abs(x) >> 1) + (abs(y) >> 1) <= p["attitude.rest_accel"]
    held = (c.moved == 0) & (c.carried_blocks == LANDED_BLOCKS) & (turn > p["attitude.rest_turn"] >> 11) & stays
    c.held_blocks = select(held, clamp(c.held_blocks + 1, 0, p["attitude.rest_blocks"]), 0 * c.held_blocks)


def travels(c: ControlState) -> Integer:
    """Whether a lasting velocity is explained by travel."""
    return c.travel_excess > TRAVELS_Q24


def held_still(c: ControlState, p: Params) -> Integer:
    """Whether the gyro alone has turned for as long as a rest takes, and the acceleration leans."""
    leans = abs(c.force_before[0]) + abs(c.force_before[1]) > p["attitude.block_steps"] << LEANS_SHIFT
    known = (c.aligned_blocks == RESTED) & (travels(c) == 0)
    return known & (c.held_blocks == p["attitude.rest_blocks"]) & leans


def lost_in_motion(c: ControlState, p: Params, lasting: Integer) -> Integer:
    """Whether the vertical acceleration is too small for seconds, or a body that turns has a lasting velocity and an
    acceleration that leans. lasting: the square of that velocity, g^2 s^2 Q24."""
    explained = wrap_u32(c.covariance[CELL[8][8]] + c.covariance[CELL[9][9]])
    over = lasting - (explained >> 6) - (p["attitude.travel_least_q24"] >> 1)
    leans = (c.rise > RISE_LEAST_Q18) & (c.turning > p["attitude.rest_turn"] >> 6) & (over > 0)
    return (c.rise > RISE_MAX_Q18) | leans


def reopen(c: ControlState, p: Params) -> None:
    """Of the bias and of the tilt nothing is known any more; both stay."""
    forget(c, p, 4 * clamp(p["attitude.start_bias"], 0, VARIANCE_MAX_Q32 // 4), p["attitude.start_tilt"] >> 3)

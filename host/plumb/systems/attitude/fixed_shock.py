"""How `attitude` notices in integers that the bias of the gyro has stepped.

The functions have the names of firmware/systems/attitude_shock.c, without plumb_attitude_.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import mulhi_i32, mulhi_near, wrap_i32
from plumb.systems.attitude.fixed_state import LANDED_BLOCKS, AttitudeState
from plumb.systems.attitude.fixed_travel import explained_q24, travels

RISE_LIMIT_Q18, RISE_LEAST_Q18 = 157286, 2621
RESTED, LEANS_SHIFT = 5, 14


def note_turn(c: AttitudeState, p: Params) -> None:
    """How the last block has turned about horizontal axes, and whether the gyro alone has turned."""
    up_q18 = c.force_before_q18[2]
    by_q18, turn_q26 = [], 0
    for turned in c.turned_sum_q28:
        half_q28 = wrap_i32(sum(turned))
        by_q18.append(mulhi_i32(wrap_i32(half_q28 << 5), up_q18))
        turn_q26 += abs(half_q28) >> 2
    c.turning_rad_q26 += mulhi_near(turn_q26 - c.turning_rad_q26, p["attitude.travel_pass_q32"] >> 1)
    x_q18 = wrap_i32(c.force_sum_q18[0] - c.force_before_q18[0] - by_q18[1])
    y_q18 = wrap_i32(c.force_sum_q18[1] - c.force_before_q18[1] + by_q18[0])
    held = (
        not c.moved
        and c.carried_blocks == LANDED_BLOCKS
        and turn_q26 > p["attitude.rest_turn"] >> 11
        and (abs(x_q18) >> 1) + (abs(y_q18) >> 1) <= p["attitude.rest_accel"]
    )
    c.held_blocks = min(c.held_blocks + 1, p["attitude.rest_blocks"]) if held else 0


def held_still(c: AttitudeState, p: Params) -> bool:
    """True when the gyro alone has turned for as long as a rest takes, although its bias was known, and the
    acceleration leans."""
    leans = abs(c.force_before_q18[0]) + abs(c.force_before_q18[1])
    return (
        c.held_blocks == p["attitude.rest_blocks"]
        and c.aligned_blocks == RESTED
        and not travels(c)
        and leans > p["attitude.block_steps"] << LEANS_SHIFT
    )


def lost_in_motion(c: AttitudeState, p: Params, lasting_q24: int) -> bool:
    """True when the vertical acceleration is too small for seconds; or a body that turns about horizontal axes has a
    lasting velocity, and its acceleration leans."""
    over_q24 = lasting_q24 - explained_q24(c) - (p["attitude.travel_least_q24"] >> 1)
    return c.rise_g_q18 > RISE_LIMIT_Q18 or (
        c.rise_g_q18 > RISE_LEAST_Q18 and c.turning_rad_q26 > p["attitude.rest_turn"] >> 6 and over_q24 > 0
    )

"""How `attitude` uses the velocity of a body, in integers: whether the body travels or flies, and its velocity by the
drag of the rotors.

The functions have the names of firmware/systems/attitude_travel.c, without plumb_attitude_.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed.error_filter import VELOCITY
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, clz32, mulhi_i32, mulhi_near, mulhi_u32, sat_i32, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_state import (
    LANDED_BLOCKS,
    MAYBE_LANDED_BLOCKS,
    VELOCITY_ADDED_Q26,
    VELOCITY_Q28,
    AttitudeState,
)

TRAVELS_Q24 = 16777
FORCE_MOST_Q18 = 4 << 18
WEIGHT_LEAST_Q16, WEIGHT_MOST_Q16 = 53084, 79299
FALLS_Q16, HOVER_MOST_Q16 = 16384, (1 << 20) - 1
HOVER_LOW_Q15, HOVER_HIGH_Q15, THRUST_MOST_Q15 = 3277, 27853, 31130
CUBE_ROOTS_Q14 = (23407, 18578, 14746, 11704, 9289, 7373)
"""0.9 * 2^(-n/3) for n from -2."""
THIRD_Q32 = 1431655765
LIFTS_GS_Q28 = 8053064
TAKE_OFF_BLOCKS, FIRST_BLOCKS, COUNT_MAX = 4, 16, 255


def velocity_saturated(x: int) -> int:
    return clamp(x, -VELOCITY_Q28, VELOCITY_Q28 - 1)


def travel_square(c: AttitudeState) -> int:
    """Square of the lasting velocity, g^2 s^2 Q24; in flight of the lasting difference from the measured one."""
    x, y = c.travel_gs_q28
    return mulhi_i32(x, x) + mulhi_i32(y, y)


def travels(c: AttitudeState) -> bool:
    """True when travel explains a lasting velocity."""
    return c.travel_excess_q24 > TRAVELS_Q24


def explained_q24(c: AttitudeState) -> int:
    """Square of the velocity that the covariance explains."""
    return wrap_u32(c.errors.variance(VELOCITY) + c.errors.variance(VELOCITY + 1)) >> 6


def travel_excess(c: AttitudeState, p: Params, lasting_q24: int, hold_q32: int) -> int:
    """Square of the lasting velocity above what the covariance and a body that stays in place explain."""
    excess = lasting_q24 - explained_q24(c) - p["attitude.travel_least_q24"]
    held = c.travel_excess_q24 - mulhi_near(c.travel_excess_q24, hold_q32) - 1
    return max(excess, held, 0)


def square_g2_q16(mean_g_q18: Sequence[int]) -> int:
    """Square of the length of a mean acceleration, g^2 Q16, components limited to 4 g."""
    square = 0
    for one in mean_g_q18:
        g_q24 = 64 * clamp(one, -FORCE_MOST_Q18, FORCE_MOST_Q18)
        square += mulhi_i32(g_q24, g_q24)
    return square


def inverse_cube_root_q14(x_q16: int) -> int:
    """x^(-1/3), Q14 of Q16, for 1/4 <= x < 16."""
    assert 1 << 14 <= x_q16 < 1 << 20, x_q16
    y = CUBE_ROOTS_Q14[17 - clz32(x_q16)]
    for _ in range(2):
        cube_q14 = (((y * y) >> 14) * y) >> 14
        y = mulhi_u32(y * ((4 << 14) - ((x_q16 * cube_q14) >> 16)), THIRD_Q32) >> 14
    return y


def learn_hover(c: AttitudeState, thrust_q15: int, square: int) -> None:
    """Learn the thrust command of a hover, Q15, from a block in flight."""
    if square < FALLS_Q16 or square > HOVER_MOST_Q16 or thrust_q15 > THRUST_MOST_Q15:
        return
    at_1_g = (thrust_q15 * inverse_cube_root_q14(square)) >> 14
    off = at_1_g - c.hover_q15
    shift = 2 if c.flown_blocks < FIRST_BLOCKS else 5 if off < 0 else 4
    c.hover_q15 = clamp(c.hover_q15 + ((off + 2) >> shift), HOVER_LOW_Q15, HOVER_HIGH_Q15)


def follow_flight(c: AttitudeState, p: Params, block_s_q32: int) -> None:
    """Follow take-off and landing, once a block."""
    mean_g_q18 = [mulhi_i32(force, p["attitude.inverse_block_q32"]) for force in c.force_sum_q18]
    square = square_g2_q16(mean_g_q18)
    thrust, hover = clamp(c.thrust_q15, 0, 32767), c.hover_q15
    lifted = clamp(wrap_i32(mean_g_q18[2] - c.weight_g_q18), -FORCE_MOST_Q18, FORCE_MOST_Q18)
    felt = c.accel_clipped_steps == 0
    weighs = felt and WEIGHT_LEAST_Q16 <= square <= WEIGHT_MOST_Q16

    c.climb_gs_q28 += mulhi_i32(lifted * 1024, block_s_q32) - (c.climb_gs_q28 >> 5)
    c.climb_gs_q28 = velocity_saturated(c.climb_gs_q28)
    if c.carried_blocks == LANDED_BLOCKS:
        if weighs:
            c.weight_g_q18 += lifted >> 5
        if thrust == 0:
            c.climb_gs_q28 = 0
        hovers = hover != 0 and 8 * thrust >= 7 * hover
        c.thrust_blocks = min(c.thrust_blocks + 1, TAKE_OFF_BLOCKS) if hovers else 0
        if thrust != 0 and (c.thrust_blocks == TAKE_OFF_BLOCKS or abs(c.climb_gs_q28) > LIFTS_GS_Q28):
            c.carried_blocks = c.flown_blocks = c.thrust_blocks = 0
            if hover == 0 or (c.climb_gs_q28 > 0 and thrust < hover):
                c.hover_q15 = clamp(thrust, HOVER_LOW_Q15, HOVER_HIGH_Q15)
        return
    c.flown_blocks = min(c.flown_blocks + 1, COUNT_MAX)
    if weighs and 4 * thrust < 3 * hover:
        c.carried_blocks += 1
        if thrust == 0 and c.carried_blocks >= MAYBE_LANDED_BLOCKS:
            c.carried_blocks = LANDED_BLOCKS
    else:
        c.carried_blocks = 0
    if c.carried_blocks >= MAYBE_LANDED_BLOCKS:
        c.climb_gs_q28 = 0
    lifts = 4 * thrust >= 3 * hover or (c.flown_blocks < FIRST_BLOCKS and 8 * thrust >= 3 * hover)
    if felt and lifts:
        learn_hover(c, thrust, square)


def measure_velocity(c: AttitudeState, p: Params, gained: Sequence[int], block_s_q32: int) -> None:
    """The velocity that the block is measured to end with: zero, or in flight that of the drag."""
    follow_flight(c, p, block_s_q32)
    if p["attitude.aid_s_q24"] == 0:
        return
    airborne = c.carried_blocks < MAYBE_LANDED_BLOCKS
    if airborne != c.airborne:
        c.travel_gs_q28 = [0, 0]
    if airborne != c.airborne or (airborne and c.carried_blocks != 0):
        c.velocity_added_q26 = VELOCITY_ADDED_Q26
    c.airborne = airborne
    for i in range(2):
        across_q18 = mulhi_i32(wrap_i32(c.force_sum_q18[i] - c.thrust_sum_q18[i]), p["attitude.inverse_block_q32"])
        drag_gs = sat_i32((-across_q18 * p["attitude.aid_s_q24"]) >> 14)
        at_end_gs = sat_i32(drag_gs + (gained[i] >> 1))
        c.measured_gs_q28[i] = velocity_saturated(at_end_gs) if airborne else 0

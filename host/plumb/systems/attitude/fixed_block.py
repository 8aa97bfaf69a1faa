"""The end of a block of `attitude` in integers, and its computations in the steps of the next block, one slice a step:
correction, judgement, growth and measurements.

The functions have the names of firmware/systems/attitude_block.c and attitude_judge.c, without plumb_attitude_.
"""

from __future__ import annotations

from plumb.kernels.fixed import error_filter
from plumb.kernels.fixed.error_filter import BIAS, SCALE, TILT, VARIANCE_LIMIT_Q32, VELOCITY
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.integers import INT32_MAX, clamp, mulhi_i32, mulhi_near, sat_i32, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_shock import RESTED, held_still, lost_in_motion, note_turn
from plumb.systems.attitude.fixed_state import (
    ACCELERATING,
    AIRBORNE,
    ALIGNING,
    FALLING,
    LANDED_BLOCKS,
    REST,
    RESTARTED,
    SLICE_CORRECT,
    SLICE_JUDGE,
    SLICE_MEASURE,
    SLICE_NONE,
    SLICE_TILT_X,
    UNSURE,
    AttitudeState,
    clear_sums,
    forget,
    start,
)
from plumb.systems.attitude.fixed_travel import (
    measure_velocity,
    travel_excess,
    travel_square,
    travels,
    velocity_saturated,
)
from plumb.systems.attitude.fixed_turns import align, turn_earth, turn_force

TWO_BY_PI_Q31 = 1367130551
BIAS_LIMIT_Q32, SCALE_LIMIT_Q32, TILT_STEP_LIMIT_Q28 = 1 << 30, 1 << 28, 1 << 26
SPEED_LIMIT_Q26 = INT32_MAX
ALIGNING_BLOCKS, ALIGN_LEAST_GS_Q26 = 4, 1 << 20
LEAST_REST_Q16, MOST_REST_Q16, TILTED_Q24 = 62300, 68853, 15099494
LONG_RESTS, RESTING_SQUARE_Q24 = 7, 104857600
MOST_BY_TURN, MOST_LASTING_Q24 = 1 << 30, 1 << 23
HOLD_Q32, FLIGHT_LEAST_Q32 = 1288490189, 2943711
CORRECTED_Q26 = 1 << 25
JUDGED = UNSURE | ACCELERATING


def correct(c: AttitudeState) -> None:
    """Apply the corrections of the block before the last one, propagated over the last block, to the state."""
    by = c.errors.correction_q28
    error_filter.predict(c.errors)
    for i in range(3):
        bias = clamp((by[BIAS + i] * TWO_BY_PI_Q31 + (1 << 30)) >> 31, -BIAS_LIMIT_Q32, BIAS_LIMIT_Q32)
        c.bias_turnps_q32[i] = clamp(c.bias_turnps_q32[i] + bias, -BIAS_LIMIT_Q32, BIAS_LIMIT_Q32)
        c.scale_q32[i] = clamp(c.scale_q32[i] + (by[SCALE + i] >> 2), -SCALE_LIMIT_Q32, SCALE_LIMIT_Q32)
    x = clamp(by[TILT], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28)
    y = clamp(by[TILT + 1], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28)
    turn_earth(c.attitude, ONE_Q30, 2 * x, 2 * y)
    turn_force(c.force_before_q18, 16 * x, 16 * y)
    for i in range(2):
        c.velocity_gs_q28[i] = sat_i32(c.velocity_gs_q28[i] + 2 * by[VELOCITY + i])


def tilted_at_rest(c: AttitudeState, p: Params) -> bool:
    """True for an acceleration of 1 g that is well off the vertical."""
    square_q16 = mean_g_q24 = 0
    for force in c.force_before_q18:
        mean_g_q24 = wrap_i32(mulhi_i32(force, p["attitude.inverse_block_q32"]) << 6)
        square_q16 += mulhi_i32(mean_g_q24, mean_g_q24)
    return LEAST_REST_Q16 < wrap_u32(square_q16) < MOST_REST_Q16 and mean_g_q24 < TILTED_Q24


def doubt(c: AttitudeState, p: Params, square_q24: int, lasting_q24: int) -> None:
    """Propagate the covariance of the velocity for the first time; unless the vertical is lost."""
    up_g_q18 = mulhi_i32(c.force_before_q18[2], p["attitude.inverse_block_q32"])
    risen_g_q18 = mulhi_near((1 << 18) - up_g_q18 - c.rise_g_q18, p["attitude.travel_pass_q32"])
    landed = c.carried_blocks == LANDED_BLOCKS
    c.rise_g_q18 = c.rise_g_q18 + risen_g_q18 if landed else 0
    held = held_still(c, p)
    long = c.still_blocks == LONG_RESTS * p["attitude.rest_blocks"] and square_q24 > RESTING_SQUARE_Q24
    if landed and c.block_flags & REST and (tilted_at_rest(c, p) or long):
        start(c, p)
        c.block_flags |= RESTARTED
    elif held or lost_in_motion(c, p, lasting_q24):
        bias = 4 * min(p["attitude.start_bias"], VARIANCE_LIMIT_Q32 // 4)
        forget(c, p, bias, p["attitude.start_tilt"] >> 3)
        if held:
            c.block_flags |= REST
    else:
        error_filter.grow_velocity(c.errors)


def judge(c: AttitudeState, p: Params) -> None:
    """Judge the velocity of a block: how far it may be taken for zero, and whether the attitude is lost."""
    hold_q32 = mulhi_i32(p["attitude.travel_pass_q32"], HOLD_Q32)
    square_q24 = off_square_q24 = corrected_q20 = 0
    for i in range(2):
        v = velocity_saturated(c.velocity_gs_q28[i])
        v = v if c.airborne else v - mulhi_near(v, p["attitude.leak_q32"])
        c.velocity_gs_q28[i] = v
        square_q24 += mulhi_i32(v, v)
        off = velocity_saturated(v - c.measured_gs_q28[i])
        off_square_q24 += mulhi_i32(off, off)
        c.travel_gs_q28[i] += mulhi_near(off - c.travel_gs_q28[i], p["attitude.travel_pass_q32"])
        kept = c.corrected_rad_q26[i] - mulhi_i32(c.corrected_rad_q26[i], hold_q32)
        corrected = clamp(kept + (c.errors.correction_q28[TILT + i] >> 2), -CORRECTED_Q26, CORRECTED_Q26 - 1)
        c.corrected_rad_q26[i] = corrected
        corrected_q20 += mulhi_i32(corrected, corrected)
    lasting_q24 = travel_square(c)
    c.velocity_square_g2s2_q24 += mulhi_near(
        square_q24 - c.velocity_square_g2s2_q24, p["attitude.velocity_pass_q32"]
    )  # fmt: skip
    c.travel_excess_q24 = 0 if c.airborne else travel_excess(c, p, lasting_q24, hold_q32)
    moving = c.velocity_square_g2s2_q24 * p["attitude.velocity_share_q16"]
    moving = (moving + c.travel_excess_q24 * p["attitude.travel_gain_q16"]) >> 14
    if c.airborne:
        c.velocity_variance_g2s2_q26 = p["attitude.aid_variance"]
    else:
        c.velocity_variance_g2s2_q26 = min(p["attitude.speed_min"] + moving, SPEED_LIMIT_Q26)

    filter_q32 = wrap_u32(c.errors.variance(TILT) + c.errors.variance(TILT + 1))
    if p["attitude.aid_s_q24"] != 0 and c.carried_blocks != LANDED_BLOCKS:
        now_q32 = FLIGHT_LEAST_Q32 + 3 * (filter_q32 >> 4)
        now_q32 += (min(lasting_q24, MOST_LASTING_Q24) << 6) + (min(off_square_q24, MOST_LASTING_Q24) << 5)
        before_q32 = c.tilt_variance_rad2_q32
        c.tilt_variance_rad2_q32 = max(now_q32, before_q32 - (before_q32 >> 3))
    else:
        shown_q20 = min(corrected_q20, filter_q32 >> 10)
        c.tilt_variance_rad2_q32 = wrap_u32(3 * ((filter_q32 >> 4) + (shown_q20 << 11)) + (lasting_q24 >> 6))
    c.block_flags &= ~JUDGED
    if c.tilt_variance_rad2_q32 > p["attitude.unsure"]:
        c.block_flags |= UNSURE
    if c.velocity_variance_g2s2_q26 > 4 * p["attitude.speed_min"]:
        c.block_flags |= ACCELERATING
    doubt(c, p, square_q24, lasting_q24)


def compute_slice(c: AttitudeState, p: Params) -> bool:
    """Compute one slice of the last block; returns true when it has turned the attitude."""
    now = c.slice
    measured = 5 if c.block_flags & REST else 2
    last = now + 1 == SLICE_MEASURE + 2 * measured
    c.slice = SLICE_NONE if last else now + 1
    if now == SLICE_CORRECT:
        correct(c)
        return True
    number, shrinks = divmod(now - SLICE_MEASURE, 2)
    if now == SLICE_JUDGE:
        judge(c, p)
    elif now < SLICE_MEASURE:
        error_filter.grow_tilt(c.errors, now - SLICE_TILT_X)
    elif shrinks:
        error_filter.shrink(c.errors)
    else:
        if number == 0:
            error_filter.grow(c.errors, 0 if travels(c) else p["attitude.q_bias"], p["attitude.q_scale"])
        if number < 2:
            off = wrap_i32(c.measured_gs_q28[number] - c.velocity_gs_q28[number]) >> 1
            error_filter.weigh(c.errors, VELOCITY + number, c.velocity_variance_g2s2_q26 << 4, off)
        else:
            mean_rate = sat_i32((c.half_mean_q32[number - 2] * p["attitude.rest_gain_q20"]) >> 20)
            error_filter.weigh(c.errors, BIAS + number - 2, p["attitude.rest_variance"], mean_rate)
    return False


def gained(force_sum_q18: int, dt_s_q33: int) -> int:
    """Velocity that a block has gained, g s Q28."""
    return sat_i32((force_sum_q18 * dt_s_q33) >> 23)


def tilt_growth(c: AttitudeState, p: Params) -> int:
    """Growth of the tilt's variance in a block, rad^2 Q32."""
    lasting_q24 = max(travel_square(c) - (p["attitude.speed_min"] >> 2), 0)
    by_turn = p["attitude.q_turn_q24"]
    if not travels(c) and not c.airborne:
        by_turn += (lasting_q24 * p["attitude.doubt_q24"]) >> 16
    growth = p["attitude.q_tilt"] + ((c.energy_q24 * min(by_turn, MOST_BY_TURN)) >> 24) + c.tilt_added_q32
    if max(c.gap_steps, c.gyro_clipped_steps) >= p["attitude.block_steps"]:
        growth += p["attitude.q_clipped"]
    return min(growth, VARIANCE_LIMIT_Q32)


def close_block(c: AttitudeState, p: Params) -> bool:
    """The last step of a block: its sums become the coupling of tilt and gyro, a velocity, and the inputs of the slices
    of the next block. Returns true when it has turned the attitude."""
    dt = p["attitude.dt_s_q33"]
    gains = [gained(c.force_sum_q18[0], dt), gained(c.force_sum_q18[1], dt)]
    aligning = c.aligned_blocks < ALIGNING_BLOCKS
    if not aligning:
        note_turn(c, p)
    moved = c.moved or c.airborne

    for i in range(3):
        further = abs(wrap_i32(c.force_sum_q18[i] - c.force_before_q18[i])) > p["attitude.rest_accel"]
        moved = moved or further or abs(c.half_sum_q32[i]) > p["attitude.rest_turn"]
        c.force_before_q18[i] = c.force_sum_q18[i]
        c.half_mean_q32[i] = mulhi_i32(c.half_sum_q32[i], p["attitude.inverse_block_q32"])
    c.still_blocks = 0 if moved else min(c.still_blocks + 1, LONG_RESTS * p["attitude.rest_blocks"])
    rests = c.still_blocks >= p["attitude.rest_blocks"]
    flags = REST if rests else 0

    if aligning:
        flags |= align_block(c, gains, gained(c.force_sum_q18[2], dt))
    else:
        flags |= measure_block(c, p, gains)
        c.slice = SLICE_CORRECT
        if rests:
            c.aligned_blocks = RESTED
    c.block_flags = flags
    c.block_step = 0
    clear_sums(c)
    return aligning


def align_block(c: AttitudeState, gains: list[int], gain_up: int) -> int:
    """The vertical is the mean of all samples so far; returns flags. The first correction keeps the velocity
    upwards."""
    x, y = sat_i32(c.velocity_gs_q28[0] + gains[0]), sat_i32(c.velocity_gs_q28[1] + gains[1])
    z = sat_i32(c.errors.correction_q28[0] + gain_up)
    half = align(c.attitude, x >> 2, y >> 2, z >> 2, ALIGN_LEAST_GS_Q26)
    c.errors.correction_q28[0] = min(half << 3, INT32_MAX)
    c.velocity_gs_q28 = [0, 0]
    c.aligned_blocks += 1
    if c.aligned_blocks == ALIGNING_BLOCKS:
        c.errors.correction_q28[0] = 0
        return UNSURE
    return UNSURE | ALIGNING


def measure_block(c: AttitudeState, p: Params, gains: list[int]) -> int:
    """Coupling, lever, velocity and growth of a block; returns flags."""
    dt = p["attitude.dt_s_q33"]
    time_q32 = (p["attitude.block_steps"] * dt) >> 1
    lever = sat_i32((c.force_sum_q18[2] * dt) >> 20)
    c.errors.half_lever_q32 = clamp(lever, time_q32 >> 2, time_q32) >> 1
    for i in range(2):
        for j in range(3):
            c.errors.coupling_q32[i][BIAS + j] = -((c.rows_sum_q22[i][j] * dt) >> 25)
            c.errors.coupling_q32[i][SCALE + j] = -(c.turned_sum_q28[i][j] >> 1)
    for i in range(2):
        c.velocity_gs_q28[i] = sat_i32(c.velocity_gs_q28[i] + gains[i])
    if p["attitude.aid_s_q24"] != 0 or c.vehicle:
        measure_velocity(c, p, gains, time_q32)

    c.errors.tilt_growth_q32 = tilt_growth(c, p)
    c.errors.velocity_growth_q32 = 16 * c.velocity_added_q26

    falling = FALLING if lever < time_q32 >> 2 else 0
    return falling | (AIRBORNE if c.airborne else 0) | (c.block_flags & JUDGED)

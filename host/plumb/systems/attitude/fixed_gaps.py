"""How `attitude` handles samples that are missing or at the limit of a sensor, in integers.

The functions have the names of firmware/systems/attitude_gaps.c, without plumb_attitude_.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed.error_filter import VARIANCE_LIMIT_Q32
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, mulhi_i32, mulhi_u32, sat_i32
from plumb.systems.attitude.fixed_state import (
    ACCEL_CLIPPED,
    GYRO_CLIPPED,
    HALF_LIMIT_Q30,
    LONGEST_RUN,
    MISSING,
    SIXTH_Q32,
    VELOCITY_ADDED_Q26,
    AttitudeState,
)
from plumb.systems.attitude.fixed_turns import turn_body

ADDED_ACCEL_G_Q20, BRIDGED_FORCE_Q18 = 1258291200, 550502400
NO_SAMPLE = -32768


def along(row: Sequence[int], x: int, y: int, z: int) -> int:
    """Component of an acceleration along a row."""
    return mulhi_i32(row[0], x) + mulhi_i32(row[1], y) + mulhi_i32(row[2], z)


def bridge(c: AttitudeState, p: Params, half: Sequence[int]) -> list[int]:
    """Bridge a gap at its next sample; returns the acceleration that the gap adds, g Q20, body axes."""
    steps = c.gap_steps
    c.gap_steps = 0
    if not c.started:
        return [0, 0, 0]
    turn_q32, force_g_q20, turn_square_q32, force_square_q18 = [], [], 0, 0
    for i in range(3):
        by = (half[i] >> 1) - 3 * c.half_sixth_q32[i]
        by_g_q25 = c.accel_g_q25[i] - 6 * c.accel_sixth_q25[i]
        turn_square_q32 += mulhi_i32(by, by)
        force_square_q18 += mulhi_i32(by_g_q25, by_g_q25)
        turn_q32.append(clamp((by * steps) >> 1, -4 * HALF_LIMIT_Q30, 4 * HALF_LIMIT_Q30))
        force_g_q20.append(clamp((by_g_q25 * steps) >> 6, -ADDED_ACCEL_G_Q20, ADDED_ACCEL_G_Q20))
    for _ in range(2):
        turn_body(c.attitude, *turn_q32)

    square = steps * steps
    c.tilt_added_q32 = min(c.tilt_added_q32 + 2 * square * turn_square_q32, VARIANCE_LIMIT_Q32)
    gap_s2_q26 = (square * mulhi_u32(p["attitude.dt_s_q33"], p["attitude.dt_s_q33"])) >> 8
    c.velocity_added_q26 = min(c.velocity_added_q26 + ((gap_s2_q26 * force_square_q18) >> 21), VELOCITY_ADDED_Q26)
    return force_g_q20


def add_force(c: AttitudeState, m: Sequence[Sequence[int]], force_g_q20: Sequence[int]) -> None:
    """Add the acceleration of a gap to the sums of the block."""
    for i in range(3):
        force_q18 = sat_i32(c.force_sum_q18[i] + along(m[i], *force_g_q20))
        c.force_sum_q18[i] = clamp(force_q18, -BRIDGED_FORCE_Q18, BRIDGED_FORCE_Q18)


def unseen(
    run: int, slope: int, clipped: bool, now: Sequence[int], sixth: Sequence[int]
) -> tuple[int, int, int]:  # fmt: skip
    """Samples in a row at the limit of a sensor; the square of the slope; and at their end n^4 times it, else 0. now:
    of this step; sixth: a sixth of the step before."""
    if clipped == (run != 0):
        return min(run + 1, LONGEST_RUN) if clipped else 0, slope, 0
    square = 0
    for i in range(3):
        by = mulhi_i32(now[i], SIXTH_Q32) - sixth[i]
        square += mulhi_i32(by, by)
    if clipped:
        return 1, square, 0
    slope = max(square, slope)
    return 0, slope, run**4 * slope


def without_acceleration(c: AttitudeState) -> None:
    """A sample with rates alone: 1 g upwards, and the velocity of the block is unknown."""
    c.accel_g_q25 = [value >> 5 for value in c.up_q30] if c.started else [0, 0, 0]
    c.velocity_added_q26 = VELOCITY_ADDED_Q26


def count_clipped(c: AttitudeState, p: Params, raw: Sequence[int], flags: int, half: Sequence[int]) -> None:
    """Count samples at the limits, and at their end add the variance of the hidden part."""
    if flags == MISSING:
        return
    gyro_clipped, accel_clipped = flags & GYRO_CLIPPED != 0, flags & ACCEL_CLIPPED != 0
    marked = raw[3] == raw[4] == raw[5] == NO_SAMPLE
    if accel_clipped and (marked or c.accel_clipped_steps >= 2 * p["attitude.block_steps"]):
        without_acceleration(c)
    if not c.started:
        return
    c.gyro_clipped_steps, c.gyro_slope_q32, turned = unseen(
        c.gyro_clipped_steps, c.gyro_slope_q32, gyro_clipped, half, c.half_sixth_q32
    )
    c.accel_clipped_steps, c.accel_slope_q18, forced = unseen(
        c.accel_clipped_steps, c.accel_slope_q18, accel_clipped, c.accel_g_q25, c.accel_sixth_q25
    )
    thrice_q32 = 4 * min(turned, VARIANCE_LIMIT_Q32)
    c.tilt_added_q32 = min(c.tilt_added_q32 + thrice_q32 // 3, VARIANCE_LIMIT_Q32)
    dt_square = mulhi_u32(p["attitude.dt_s_q33"], p["attitude.dt_s_q33"])
    square_q26 = (min(forced >> 10, 1 << 40) * dt_square) >> 16
    added_q26 = min(square_q26, 3 * VELOCITY_ADDED_Q26) // 3
    c.velocity_added_q26 = min(c.velocity_added_q26 + added_q26, VELOCITY_ADDED_Q26)

"""`attitude` in integers: counts of six channels to a quaternion (docs/reference/arithmetic/attitude.md).

The functions have the names of firmware/systems/attitude.c.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed import mounting, validity
from plumb.kernels.fixed.kernels import Params, calibration_apply
from plumb.kernels.fixed.mounting import mount
from plumb.kernels.integers import clamp, mulhi_i32, wrap_i32
from plumb.systems.attitude.fixed_block import close_block, compute_slice
from plumb.systems.attitude.fixed_gaps import NO_SAMPLE, add_force, along, bridge, count_clipped
from plumb.systems.attitude.fixed_state import (
    ACCEL_CLIPPED,
    GYRO_CLIPPED,
    HALF_LIMIT_Q30,
    LONGEST_RUN,
    MISSING,
    SIXTH_Q32,
    SLICE_NONE,
    AttitudeState,
    control_init,
)
from plumb.systems.attitude.fixed_turns import align, matrix_of, turn_body

__all__ = ["control_init", "control_step", "control_valid"]

ALIGN_LEAST_G_Q24 = 1258291
"""0.15 g, half of it: a shorter acceleration has no usable direction."""
CLIPPED = GYRO_CLIPPED | ACCEL_CLIPPED


def sense(p: Params, group: str, raw: Sequence[int]) -> tuple[tuple[int, int, int], bool]:
    """Calibrated values of one sensor in the body's axes, and whether one of them was at its limit."""
    x, x_clamped = calibration_apply(p, group, raw[0])
    y, y_clamped = calibration_apply(p, group, raw[1])
    z, z_clamped = calibration_apply(p, group, raw[2])
    clamped = x_clamped or y_clamped or z_clamped
    if not p["attitude.mounted"]:
        return (x, y, z), clamped
    mounted, limited = mount(p, f"{group}_mounting", (x, y, z))
    return mounted, clamped or limited


def corrected(c: AttitudeState, axis: int, rate_q28: int) -> int:
    """Rate of one axis, less bias and scale error."""
    return rate_q28 - (c.bias_turnps_q32[axis] >> 4) - mulhi_i32(c.scale_q32[axis], rate_q28)


def half_angle(rate_q28: int, per_rate: int) -> int:
    """Half the angle that a rate turns in a step, rad Q32, within 1/2."""
    return clamp(mulhi_i32(rate_q28, per_rate), -HALF_LIMIT_Q30, HALF_LIMIT_Q30) * 4


def take_sample(c: AttitudeState, p: Params, raw: Sequence[int]) -> int:
    """Rate and acceleration of a sample, in body axes; returns flags."""
    (rx, ry, rz), gyro_clipped = sense(p, "gyro", raw[:3])
    (ax, ay, az), accel_clipped = sense(p, "accel", raw[3:])
    c.accel_g_q25 = [ax >> 1, ay >> 1, az >> 1]
    c.rate_turnps_q28 = [corrected(c, 0, rx), corrected(c, 1, ry), corrected(c, 2, rz)]
    return (GYRO_CLIPPED if gyro_clipped else 0) | (ACCEL_CLIPPED if accel_clipped else 0)


def sixths(values: Sequence[int]) -> list[int]:
    return [mulhi_i32(value, SIXTH_Q32) for value in values]


def add_row(rows: list[int], turned: list[int], m: Sequence[int], half: Sequence[int]) -> None:
    """One row of the attitude's matrix into the coupling of the block."""
    for j in range(3):
        rows[j] += m[j] >> 8
        turned[j] += mulhi_i32(m[j], half[j]) >> 2


def control_step(c: AttitudeState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    c.thrust_q15 = setpoint
    c.step += 1

    flags = MISSING
    last = c.block_step + 1 == p["attitude.block_steps"]
    if raw[0] == NO_SAMPLE or (c.gap_steps != 0 and last):
        c.missing_steps += 1
        c.gap_steps = min(c.gap_steps + 1, LONGEST_RUN)
    else:
        flags = take_sample(c, p, raw)
    half = hx, hy, hz = [half_angle(rate, p["attitude.half_angle"]) for rate in c.rate_turnps_q28]
    if flags & CLIPPED or c.gyro_clipped_steps or c.accel_clipped_steps:
        count_clipped(c, p, raw, flags, half)
    ax, ay, az = c.accel_g_q25
    bridged = c.gap_steps != 0 and flags != MISSING
    force_g_q20 = bridge(c, p, half) if bridged else [0, 0, 0]
    if not c.started:
        length = align(c.attitude, ax >> 1, ay >> 1, az >> 1, ALIGN_LEAST_G_Q24)
        c.started = length >= ALIGN_LEAST_G_Q24
        c.half_sixth_q32, c.accel_sixth_q25 = sixths(half), sixths(c.accel_g_q25)
        c.half_mean_q32 = list(half)

    # the mean acceleration of the step, with sculling; then coning
    sx, sy, sz = c.half_sixth_q32
    ex, ey, ez = wrap_i32(sx - hx), wrap_i32(sy - hy), wrap_i32(sz - hz)
    bx, by, bz = c.accel_sixth_q25
    fx = ax + mulhi_i32(ey, az) - mulhi_i32(ez, ay) + mulhi_i32(by, hz) - mulhi_i32(bz, hy)
    fy = ay + mulhi_i32(ez, ax) - mulhi_i32(ex, az) + mulhi_i32(bz, hx) - mulhi_i32(bx, hz)
    fz = az + mulhi_i32(ex, ay) - mulhi_i32(ey, ax) + mulhi_i32(bx, hy) - mulhi_i32(by, hx)
    turn_x = hx + mulhi_i32(sy, hz) - mulhi_i32(sz, hy)
    turn_y = hy + mulhi_i32(sz, hx) - mulhi_i32(sx, hz)
    turn_z = hz + mulhi_i32(sx, hy) - mulhi_i32(sy, hx)
    c.half_sixth_q32, c.accel_sixth_q25 = sixths(half), sixths(c.accel_g_q25)

    c.energy_q24 += turn_body(c.attitude, turn_x, turn_y, turn_z) >> 6
    m = matrix_of(c.attitude)
    if bridged:
        add_force(c, m, force_g_q20)
    for i in range(3):
        c.force_sum_q18[i] += along(m[i], fx, fy, fz) >> 5
    if p["attitude.aid_s_q24"] != 0:
        c.thrust_sum_q18[0] += mulhi_i32(m[0][2], fz) >> 5
        c.thrust_sum_q18[1] += mulhi_i32(m[1][2], fz) >> 5
    add_row(c.rows_sum_q22[0], c.turned_sum_q28[0], m[0], half)
    add_row(c.rows_sum_q22[1], c.turned_sum_q28[1], m[1], half)
    for i in range(3):
        c.half_sum_q32[i] = wrap_i32(c.half_sum_q32[i] + half[i])
        if abs(wrap_i32(half[i] - c.half_mean_q32[i])) > p["attitude.rest_gyro"]:
            c.moved = True

    turned = c.slice != SLICE_NONE and not bridged and compute_slice(c, p)
    c.block_step += 1
    if c.block_step == p["attitude.block_steps"]:
        turned |= close_block(c, p)
    c.up_q30 = (matrix_of(c.attitude) if turned else m)[2]
    c.flags = flags | c.block_flags
    return (
        *raw, setpoint, *c.rate_turnps_q28, *c.accel_g_q25, *c.attitude, *c.up_q30, *c.bias_turnps_q32, *c.scale_q32,
        *c.velocity_gs_q28, c.velocity_square_g2s2_q24, c.velocity_variance_g2s2_q26, c.tilt_variance_rad2_q32,
        c.block_step, c.missing_steps, c.flags, c.step,
    )  # fmt: skip


def control_valid(p: Params) -> bool:
    dt, steps, mounted = (p[f"attitude.{name}"] for name in ("dt_s_q33", "block_steps", "mounted"))
    sensors = ("gyro", "accel")
    return (
        all(validity.calibration(p, name) and mounting.valid(p, f"{name}_mounting") for name in sensors)
        and 0 <= dt <= 188978561
        and 15 <= steps <= 125
        and mounted <= 1
        and steps * dt <= 2731598643
        and steps * (p["attitude.half_angle"] & 0xFFFFFFFF) <= 1 << 34
    )

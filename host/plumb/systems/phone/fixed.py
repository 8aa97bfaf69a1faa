"""`phone` in integers: counts of six channels to pitch and roll (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed import validity
from plumb.kernels.fixed.kernels import (
    KalmanState,
    Params,
    calibrate,
    driving_rate,
    kalman_bias,
    kalman_init,
    kalman_step,
    kalman_tilt,
)
from plumb.kernels.fixed.trig import atan2, length, reciprocal, sincos
from plumb.kernels.integers import Integer, clamp, clz32, select, wrap_i32, wrap_i64, wrap_u32

SINGULAR_G_Q25, SINGULAR_G_Q26 = 5033165, 10066330
COSINE_MIN_Q30 = 1 << 26
STILL_TURNPS_Q28 = 3728270
RATE_LIMIT_Q28 = (1 << 31) - 64
QUARTER_TURN_Q32, HALF_TURN_Q61 = 1 << 30, 1 << 60
ROLL_NOISE = ("qa_hi", "qa_lo", "qb", "qb_frac_q30")
START = ("bias_hi", "bias_lo", "tilt_turn_q32", "p00_hi", "p00_lo", "p01_hi", "p01_lo", "p11_hi", "p11_lo")


@dataclass(slots=True)
class ControlState:
    pitch: KalmanState
    roll: KalmanState
    roll_p: Params
    """The parameters of roll's filter under the names of pitch's."""
    rate: tuple[Integer, Integer, Integer] = (0, 0, 0)
    uncorrected_steps: Integer = 0
    clamped_steps: Integer = 0
    step: int = 0


def roll_filter(p: Params) -> Params:
    own = {f"kalman.{name}": p[f"roll.{name}"] for name in ROLL_NOISE}
    return {**p, **own, **{f"start.{name}": p[f"roll.start.{name}"] for name in START}}


def saturated(x: Integer, n: int) -> Integer:
    """x * 2^n / 2^32, saturated to 32 bits."""
    limit = 1 << (31 - n)
    hi = clamp(x >> 32, -limit, limit - 1)
    return wrap_i32(wrap_i64(((hi << 32) + wrap_u32(x)) << n) >> 32)


def tangent_of(pitch: Integer) -> Integer:
    """Tangent of pitch, Q26, limited to +-16."""
    sine, cosine = sincos(pitch)
    cosine = clamp(cosine, COSINE_MIN_Q30, 1 << 30)
    n = clz32(cosine)
    return saturated(sine * (reciprocal(cosine << (n - 1)) >> (6 - n)), 2)


def predicted(k: KalmanState, p: Params, rate: Integer) -> Integer:
    """The measurement for which the innovation is 0, turn Q32."""
    return wrap_i32(wrap_i64(k.tilt_turn_q61 - k.bias_turn_q61 + rate * p["kalman.dt_s_q33"]) >> 29)


def control_init(p: Params) -> ControlState:
    roll_p = roll_filter(p)
    return ControlState(kalman_init(p), kalman_init(roll_p), roll_p)


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint_turn_q32: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step += 1
    taken = [calibrate(count, p, channel) for count, channel in zip(raw, ["gyro"] * 3 + ["accel"] * 3, strict=True)]
    x, y, z, accel_x, accel_y, accel_z = (value for value, _ in taken)
    clamped = [flag for _, flag in taken]
    before = (x, y, z) if c.step == 1 else c.rate
    wx, wy, wz = (driving_rate(p, new, old) for new, old in zip((x, y, z), before, strict=True))
    c.rate = (x, y, z)

    lateral = length(accel_y, accel_z)
    pitch_measured, roll_measured = atan2(-(accel_x >> 1), lateral), atan2(accel_y, accel_z)
    roll_lost = lateral < SINGULAR_G_Q25
    pitch_lost = roll_lost & (abs(accel_x) < SINGULAR_G_Q26)

    euler = p["phone.rates"] == 1
    over = euler & (lateral >= SINGULAR_G_Q25) & (abs(kalman_tilt(c.pitch)) > QUARTER_TURN_Q32)
    c.pitch.tilt_turn_q61 = select(over, wrap_i64(HALF_TURN_Q61 - c.pitch.tilt_turn_q61), c.pitch.tilt_turn_q61)
    c.pitch.bias_turn_q61 = select(over, -c.pitch.bias_turn_q61, c.pitch.bias_turn_q61)
    c.roll.tilt_turn_q61 = select(over, wrap_i64(c.roll.tilt_turn_q61 + HALF_TURN_Q61), c.roll.tilt_turn_q61)
    still = (abs(wx) < STILL_TURNPS_Q28) & (abs(wy) < STILL_TURNPS_Q28) & (abs(wz) < STILL_TURNPS_Q28)
    tangent = select(roll_lost & still | (p["phone.rates"] == 0), 0 * wx, tangent_of(kalman_tilt(c.pitch)))
    sin_roll, cos_roll = sincos(kalman_tilt(c.roll))
    across = saturated(wy * sin_roll + wz * cos_roll, 2)
    pitch_rate = select(euler, saturated(wy * cos_roll - wz * sin_roll, 2), wy)
    roll_rate = select(euler, saturated(tangent * across + (wx << 26), 6), wx)

    pitch_r = select(pitch_lost, p["tilt.r_max"], p["tilt.r_base"])
    roll_r = select(roll_lost, p["roll.r_max"], p["roll.r_base"])
    other = c.roll_p
    kalman_step(c.pitch, p, pitch_r, select(pitch_lost, predicted(c.pitch, p, pitch_rate), pitch_measured), pitch_rate)
    kalman_step(c.roll, other, roll_r, select(roll_lost, predicted(c.roll, other, roll_rate), roll_measured), roll_rate)

    at_limit = [abs(rate) >= RATE_LIMIT_Q28 for rate in (pitch_rate, roll_rate)]
    gyro_clamped = clamped[0] | clamped[1] | clamped[2] | select(at_limit[0] | at_limit[1], 1, 0)
    accel_clamped = clamped[3] | clamped[4] | clamped[5]
    c.clamped_steps = c.clamped_steps + (gyro_clamped | accel_clamped)
    c.uncorrected_steps = c.uncorrected_steps + select(roll_lost, 1, 0)
    flags = gyro_clamped | accel_clamped << 1 | select(roll_lost, 4, 0) | select(pitch_lost, 8, 0)
    pitch_bias, roll_bias = kalman_bias(c.pitch, p), kalman_bias(c.roll, other)
    return (
        *raw, setpoint_turn_q32, x, y, z, accel_x, accel_y, accel_z, tangent, pitch_rate, roll_rate,
        pitch_measured, roll_measured, pitch_r, roll_r, *filter_words(c.pitch), *filter_words(c.roll),
        kalman_tilt(c.pitch), pitch_bias, wrap_i32(pitch_rate - pitch_bias),
        kalman_tilt(c.roll), roll_bias, wrap_i32(roll_rate - roll_bias),
        c.uncorrected_steps, c.clamped_steps, flags, c.step,
    )  # fmt: skip


def filter_words(k: KalmanState) -> tuple[Integer, ...]:
    """The words of plumb_kalman_t, in order."""
    return (
        k.tilt_turn_q61, k.bias_turn_q61, k.p00, k.p01, k.p11, k.p11_frac_q30, k.innovation_turn_q32, k.k0_q29, k.k1_q29
    )  # fmt: skip


def control_valid(p: Params) -> bool:
    channels = validity.calibration(p, "gyro") and validity.calibration(p, "accel") and validity.tilt(p)
    roll = 1 <= int(p["roll.r_base"]) <= int(p["roll.r_max"]) <= validity.VARIANCE_MAX and int(p["phone.rates"]) <= 1
    return channels and roll and validity.kalman(p) and validity.kalman(p, "roll", "roll.start")

"""`phone` in integers: counts of six channels to pitch and roll (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed import validity
from plumb.kernels.fixed.kernels import (
    KalmanState,
    Params,
    calibration_apply,
    driving_rate,
    kalman_bias,
    kalman_init,
    kalman_predicted,
    kalman_step,
    kalman_tilt,
)
from plumb.kernels.fixed.trig import atan2, length, reciprocal, sincos
from plumb.kernels.integers import clz32, sat_shl_hi, wrap_i32, wrap_i64

SINGULAR_G_Q25, SINGULAR_G_Q26 = 5033165, 10066330
COSINE_MIN_Q30 = 1 << 26
STILL_TURNPS_Q28 = 3728270
RATE_LIMIT_Q28 = (1 << 31) - 64
QUARTER_TURN_Q32, HALF_TURN_Q61 = 1 << 30, 1 << 60
EULER_RATES = 1
FLAG_GYRO_CLAMPED, FLAG_ACCEL_CLAMPED, FLAG_ROLL_UNCORRECTED, FLAG_PITCH_UNCORRECTED = (1 << bit for bit in range(4))
ROLL_NOISE = ("qa_hi", "qa_lo", "qb", "qb_frac_q30")
START = ("bias_hi", "bias_lo", "tilt_turn_q32", "p00_hi", "p00_lo", "p01_hi", "p01_lo", "p11_hi", "p11_lo")


@dataclass(slots=True)
class PhoneState:
    pitch: KalmanState
    roll: KalmanState
    roll_p: Params
    """The parameters of roll's filter under the names of pitch's."""
    rate: tuple[int, int, int] = (0, 0, 0)
    uncorrected_steps: int = 0
    clamped_steps: int = 0
    step: int = 0


def roll_filter(p: Params) -> Params:
    own = {f"kalman.{name}": p[f"roll.{name}"] for name in ROLL_NOISE}
    return {**p, **own, **{f"start.{name}": p[f"roll.start.{name}"] for name in START}}


def control_init(p: Params) -> PhoneState:
    roll_p = roll_filter(p)
    return PhoneState(kalman_init(p), kalman_init(roll_p), roll_p)


def change_sides(c: PhoneState) -> None:
    """Beyond 90 degrees of pitch: the other angles of the same attitude."""
    if abs(kalman_tilt(c.pitch)) > QUARTER_TURN_Q32:
        c.pitch.tilt_turn_q61 = wrap_i64(HALF_TURN_Q61 - c.pitch.tilt_turn_q61)
        c.pitch.bias_turn_q61 = -c.pitch.bias_turn_q61
        c.roll.tilt_turn_q61 = wrap_i64(c.roll.tilt_turn_q61 + HALF_TURN_Q61)


def euler_rates(c: PhoneState, x: int, y: int, z: int, roll_lost: bool) -> tuple[int, int, int]:
    """Tangent of pitch, Q26, the cosine not below 1/16; and the rates of pitch and roll, turn/s Q28."""
    sin_pitch, cos_pitch = sincos(kalman_tilt(c.pitch))
    sin_roll, cos_roll = sincos(kalman_tilt(c.roll))

    cosine = max(cos_pitch, COSINE_MIN_Q30)
    n = clz32(cosine)
    secant_q26 = reciprocal(cosine << (n - 1)) >> (6 - n)
    still = abs(x) < STILL_TURNPS_Q28 and abs(y) < STILL_TURNPS_Q28 and abs(z) < STILL_TURNPS_Q28
    tangent_q26 = 0 if roll_lost and still else sat_shl_hi(sin_pitch * secant_q26, 2)
    across = sat_shl_hi(y * sin_roll + z * cos_roll, 2)
    pitch_rate = sat_shl_hi(y * cos_roll - z * sin_roll, 2)
    roll_rate = sat_shl_hi(tangent_q26 * across + (x << 26), 6)
    return tangent_q26, pitch_rate, roll_rate


def estimate(k: KalmanState, p: Params, measured: int, variance: int, lost: bool, rate: int) -> tuple[int, int, int]:
    """One axis: tilt, bias and corrected rate. A lost measurement is replaced by the one that corrects nothing."""
    kalman_step(k, p, variance, kalman_predicted(k, p, rate) if lost else measured, rate)
    bias = kalman_bias(k, p)
    return kalman_tilt(k), bias, wrap_i32(rate - bias)


def control_step(c: PhoneState, p: Params, raw: Sequence[int], setpoint_turn_q32: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    rate_x, x_clamped = calibration_apply(p, "gyro", raw[0])
    rate_y, y_clamped = calibration_apply(p, "gyro", raw[1])
    rate_z, z_clamped = calibration_apply(p, "gyro", raw[2])
    flags = FLAG_GYRO_CLAMPED if x_clamped or y_clamped or z_clamped else 0
    accel_x, x_clamped = calibration_apply(p, "accel", raw[3])
    accel_y, y_clamped = calibration_apply(p, "accel", raw[4])
    accel_z, z_clamped = calibration_apply(p, "accel", raw[5])
    flags |= FLAG_ACCEL_CLAMPED if x_clamped or y_clamped or z_clamped else 0

    lateral_q25 = length(accel_y, accel_z)
    pitch_measured = atan2(-(accel_x >> 1), lateral_q25)
    roll_measured = atan2(accel_y, accel_z)
    roll_lost = lateral_q25 < SINGULAR_G_Q25
    pitch_lost = roll_lost and abs(accel_x) < SINGULAR_G_Q26
    if roll_lost:
        c.uncorrected_steps += 1
        flags |= FLAG_ROLL_UNCORRECTED
    if pitch_lost:
        flags |= FLAG_PITCH_UNCORRECTED

    first = c.step == 0
    x = driving_rate(p, first, rate_x, c.rate[0])
    y = driving_rate(p, first, rate_y, c.rate[1])
    z = driving_rate(p, first, rate_z, c.rate[2])
    c.step += 1
    c.rate = rate_x, rate_y, rate_z
    if p["phone.rates"] == EULER_RATES:
        if not roll_lost:
            change_sides(c)
        tangent_q26, pitch_rate, roll_rate = euler_rates(c, x, y, z, roll_lost)
    else:
        tangent_q26, pitch_rate, roll_rate = 0, y, x
    if abs(pitch_rate) >= RATE_LIMIT_Q28 or abs(roll_rate) >= RATE_LIMIT_Q28:
        flags |= FLAG_GYRO_CLAMPED
    if flags & (FLAG_GYRO_CLAMPED | FLAG_ACCEL_CLAMPED):
        c.clamped_steps += 1

    pitch_variance = p["tilt.r_max"] if pitch_lost else p["tilt.r_base"]
    roll_variance = p["roll.r_max"] if roll_lost else p["roll.r_base"]
    pitch = estimate(c.pitch, p, pitch_measured, pitch_variance, pitch_lost, pitch_rate)
    roll = estimate(c.roll, c.roll_p, roll_measured, roll_variance, roll_lost, roll_rate)
    return (
        *raw, setpoint_turn_q32, rate_x, rate_y, rate_z, accel_x, accel_y, accel_z, tangent_q26, pitch_rate, roll_rate,
        pitch_measured, roll_measured, pitch_variance, roll_variance, *c.pitch.words(), *c.roll.words(),
        *pitch, *roll, c.uncorrected_steps, c.clamped_steps, flags, c.step,
    )  # fmt: skip


def control_valid(p: Params) -> bool:
    channels = validity.calibration(p, "gyro") and validity.calibration(p, "accel") and validity.tilt(p)
    roll = 1 <= p["roll.r_base"] <= p["roll.r_max"] <= validity.VARIANCE_MAX and p["phone.rates"] <= 1
    return channels and roll and validity.kalman(p) and validity.kalman(p, "roll", "roll.start")

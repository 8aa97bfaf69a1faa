"""`phone` in float64: pitch and roll as in the source, and with Euler rates.

    pitch = -asin(fx / |f|)     roll = atan2(fy, fz)
    x = [pitch, b_pitch, roll, b_roll]^T; A, B, Q block-diagonal, H picks the two angles, R = diag(r_pitch, r_roll):
    two independent filters of equations (1) to (5)

The source prints roll as an arcsine of fz over sqrt(fy^2 + fz^2), which is 90 deg for a phone that lies flat: a
mistaken axis for atan2(fy, fz). It drives the filters with the body rates, u = (wy, wx); the Euler rates are

    pitch' = wy cos(roll) - wz sin(roll)
    roll'  = wx + tan(pitch) (wy sin(roll) + wz cos(roll))

with the last estimated angles, the cosine of pitch at least 1/16, and both rates limited to +-8 turn/s. While
sqrt(fy^2 + fz^2) < 0.15 g, roll cannot be measured: the innovation is 0, the variances propagate as if R were
r_left_out, and if no rate reaches 5 deg/s, roll' = wx, because the tangent would turn the bias of wz into a drift.
While |fx| is below 0.15 g, too, the phone is falling, and pitch is not corrected either. If roll can be measured and
pitch is beyond +-90 deg, the phone has passed the vertical: (180 - pitch, roll + 180) is the same attitude and agrees
with the measured angles; the rate of pitch then changes its sign, and so does its bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference.kernels import (
    KalmanState,
    Number,
    calibrate,
    clip,
    driving_rate,
    kalman_init,
    kalman_step,
    wrap,
)
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Kalman
from plumb.systems.phone.tuning import PhoneAxis, PhoneTuning

SINGULAR_G = 0.15
COSINE_MIN = 1.0 / 16.0
STILL_DPS = 5.0
RATE_MAX_DPS = 8 * 360.0
"""Limit of an Euler rate, which only the tangent can reach."""


def measured(force_g: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pitch and roll of a specific force (3, ...), deg."""
    x, y, z = force_g
    length = np.sqrt(x * x + y * y + z * z)
    pitch_deg = -np.degrees(np.arcsin(clip(x / np.where(length > 0.0, length, 1.0), -1.0, 1.0)))
    return pitch_deg, np.degrees(np.arctan2(y, z))


def rates_of(
    tuning: PhoneTuning, pitch_deg: Number, roll_deg: Number, rate_dps: FloatArray, roll_lost: Number
) -> tuple[Number, Number]:
    """Rates that drive the filters of pitch and roll, deg/s, from the body rates (3, ...)."""
    wx, wy, wz = rate_dps
    if tuning.rates == "body":
        return wy, wx
    pitch, roll = np.radians(pitch_deg), np.radians(roll_deg)
    still = np.max(np.abs(rate_dps), axis=0) < STILL_DPS
    tangent = np.where(roll_lost & still, 0.0, np.sin(pitch) / np.maximum(np.cos(pitch), COSINE_MIN))
    across = wy * np.sin(roll) + wz * np.cos(roll)
    pitch_rate, roll_rate = wy * np.cos(roll) - wz * np.sin(roll), wx + tangent * across
    return clip(pitch_rate, -RATE_MAX_DPS, RATE_MAX_DPS), clip(roll_rate, -RATE_MAX_DPS, RATE_MAX_DPS)


def change_sides(pitch: KalmanState, roll: KalmanState, roll_lost: Number) -> None:
    """Replace angles with pitch beyond +-90 deg by the equivalent ones that the accelerometer measures."""
    over = (np.abs(pitch.tilt_deg) > 90.0) & ~np.asarray(roll_lost)
    pitch.tilt_deg = np.where(over, wrap(180.0 - pitch.tilt_deg), pitch.tilt_deg)
    pitch.bias_dps = np.where(over, -pitch.bias_dps, pitch.bias_dps)
    roll.tilt_deg = np.where(over, wrap(roll.tilt_deg + 180.0), roll.tilt_deg)


def correct(
    x: KalmanState, tuning: PhoneTuning, axis: PhoneAxis, settings: Kalman, z_deg: Number, u_dps: Number, lost: Number
) -> tuple[Number, Number]:
    """One step of one filter with input u; no correction where the measurement is missing. Returns bias and R."""
    r_deg2 = np.where(lost, tuning.r_left_out_deg2, axis.r_deg2)
    expected_deg = x.tilt_deg + tuning.period_s * (u_dps - x.bias_dps)
    kalman_step(x, settings, tuning.period_s, np.where(lost, expected_deg, z_deg), u_dps, r_deg2)
    return clip(x.bias_dps, -tuning.bias_max_dps, tuning.bias_max_dps), r_deg2


def run_control(
    tuning: PhoneTuning, raw: npt.ArrayLike, _setpoint: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to angles. raw: (steps, 6[, runs]); setpoint: unused.

    Returns float arrays (steps[, runs]) by name: pitch_, roll_ with measured_deg, rate_dps, deg, bias_dps, r_deg2.
    """
    counts = np.moveaxis(np.asarray(raw, np.float64), 1, 0)
    rate_dps, force_g = calibrate(counts[:3], tuning.gyro), calibrate(counts[3:], tuning.accel)
    pitch_measured_deg, roll_measured_deg = measured(force_g)
    roll_lost = np.hypot(force_g[1], force_g[2]) < SINGULAR_G
    pitch_lost = roll_lost & (np.abs(force_g[0]) < SINGULAR_G)
    before_dps = np.concatenate([rate_dps[:, :1], rate_dps[:, :-1]], axis=1)
    driving_dps = np.asarray(driving_rate(tuning.rate, rate_dps, before_dps), np.float64)

    pitch, roll = kalman_init(tuning.pitch.start), kalman_init(tuning.roll.start)
    settings = [replace(tuning.kalman(axis), rate="current") for axis in (tuning.pitch, tuning.roll)]
    rows = []
    for k in range(counts.shape[1]):
        if tuning.rates == "euler":
            change_sides(pitch, roll, roll_lost[k])
        pitch_rate_dps, roll_rate_dps = rates_of(tuning, pitch.tilt_deg, roll.tilt_deg, driving_dps[:, k], roll_lost[k])
        first = correct(pitch, tuning, tuning.pitch, settings[0], pitch_measured_deg[k], pitch_rate_dps, pitch_lost[k])
        second = correct(roll, tuning, tuning.roll, settings[1], roll_measured_deg[k], roll_rate_dps, roll_lost[k])
        rows.append((pitch_rate_dps, pitch.tilt_deg, *first, roll_rate_dps, roll.tilt_deg, *second))
    names = [f"{axis}_{name}" for axis in ("pitch", "roll") for name in ("rate_dps", "deg", "bias_dps", "r_deg2")]
    columns = {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}
    return {"pitch_measured_deg": pitch_measured_deg, "roll_measured_deg": roll_measured_deg, **columns}

"""`quad` in integers: raw counts to the pulses of two opposing motors (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed import kernels, plausibility, validity
from plumb.kernels.fixed.kernels import KalmanState, Params, PidState
from plumb.kernels.integers import Integer, clamp, select, wrap_i32

FLAG_COMMAND_LIMITED = 1 << 3


@dataclass(slots=True)
class ControlState:
    kalman: KalmanState
    pid: PidState
    rate_turnps_q28: Integer = 0
    clamped_steps: Integer = 0
    step: int = 0


def esc(command_q22: Integer, p: Params) -> tuple[Integer, Integer]:
    """Pulses of the two opposing motors in half-microseconds."""
    d = ((command_q22 >> 6) * p["esc.span_halfus"] + (1 << 15)) >> 16
    mid, low, high = p["esc.mid_halfus"], p["esc.min_halfus"], p["esc.max_halfus"]
    return clamp(mid + d, low, high), clamp(mid - d, low, high)


def control_init(p: Params) -> ControlState:
    return ControlState(kernels.kalman_init(p), PidState())


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint_turn_q32: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step += 1
    previous = c.rate_turnps_q28
    rate, gyro_clamped = kernels.calibrate(raw[0], p, "gyro")
    accel_y, y_clamped = kernels.calibrate(raw[1], p, "accel")
    accel_z, z_clamped = kernels.calibrate(raw[2], p, "accel_up")
    c.rate_turnps_q28 = rate
    u = rate if c.step == 1 else kernels.driving_rate(p, rate, previous)
    measured = kernels.tilt(accel_y, accel_z, p)
    variance = kernels.trust(accel_y, accel_z, p)
    k, pid = c.kalman, c.pid
    kernels.kalman_step(k, p, variance, measured, u)

    tilt_turn_q32, bias = kernels.kalman_tilt(k), kernels.kalman_bias(k, p)
    rate_corrected = rate - bias
    error = wrap_i32(setpoint_turn_q32 - tilt_turn_q32)
    kernels.pid_step(pid, p, error, rate_corrected)
    pulse = esc(pid.command_q22, p)
    clamped = gyro_clamped | y_clamped << 1 | z_clamped << 2
    c.clamped_steps = c.clamped_steps + select(clamped != 0, 1, 0)
    flags = clamped | select(pid.excess_q22 != 0, FLAG_COMMAND_LIMITED, 0)
    return (
        *raw, setpoint_turn_q32, rate, accel_y, accel_z, measured, variance,
        k.tilt_turn_q61, k.bias_turn_q61, k.p00, k.p01, k.p11, k.p11_frac_q30,
        k.innovation_turn_q32, k.k0_q29, k.k1_q29,
        tilt_turn_q32, bias, rate_corrected, c.clamped_steps,
        pid.integral_q54, pid.command_q22, pid.rate_filtered_turnps_q27, pid.excess_q22, error,
        *pulse, flags, c.step,
    )  # fmt: skip


def control_retune(c: ControlState, old: Params, new: Params) -> None:
    """Other gains from the next step on."""
    kernels.pid_retune(c.pid, old, new)


def control_valid(p: Params) -> bool:
    channels = all(validity.calibration(p, group) for group in ("gyro", "accel", "accel_up"))
    return channels and validity.tilt(p) and validity.kalman(p) and validity.pid(p) and validity.esc(p)


PLAUSIBLE = plausibility.Bounds(
    setpoint="setpoint_turn_q32",
    accel=("accel_y_g_q26", "accel_z_g_q26"),
    accel_g2_q20=(round(0.6**2 * 2**20), round(1.4**2 * 2**20)),
    rest_g2_q20=(round(0.9**2 * 2**20), round(1.1**2 * 2**20)),
    rest_turnps_q28=round(5.0 / 360.0 * 2**28),
    uneven_turn_q32=round(13.0 / 360.0 * 2**32),
    ready_turn_q32=round(15.0 / 360.0 * 2**32),
)

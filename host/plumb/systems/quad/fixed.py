"""`quad` in integers: raw counts to the pulses of two opposing motors (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed import kernels, plausibility, validity
from plumb.kernels.fixed.kernels import KalmanState, Params, PidState
from plumb.kernels.integers import clamp, wrap_i32

FLAG_GYRO_CLAMPED, FLAG_ACCEL_Y_CLAMPED, FLAG_ACCEL_Z_CLAMPED, FLAG_COMMAND_LIMITED = (1 << bit for bit in range(4))


@dataclass(slots=True)
class QuadState:
    kalman: KalmanState
    pid: PidState
    rate_turnps_q28: int = 0
    clamped_steps: int = 0
    step: int = 0


def control_init(p: Params) -> QuadState:
    return QuadState(kernels.kalman_init(p), PidState())


def pulses(p: Params, command_q22: int) -> tuple[int, int]:
    """Pulses of the two opposing motors in half-microseconds."""
    mid, low, high = p["esc.mid_halfus"], p["esc.min_halfus"], p["esc.max_halfus"]
    thrust = ((command_q22 >> 6) * p["esc.span_halfus"] + (1 << 15)) >> 16
    return clamp(mid + thrust, low, high), clamp(mid - thrust, low, high)


def control_step(c: QuadState, p: Params, raw: Sequence[int], setpoint_turn_q32: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    k, pid = c.kalman, c.pid
    rate, gyro_clamped = kernels.calibration_apply(p, "gyro", raw[0])
    accel_y, y_clamped = kernels.calibration_apply(p, "accel", raw[1])
    accel_z, z_clamped = kernels.calibration_apply(p, "accel_up", raw[2])
    driving = kernels.driving_rate(p, c.step == 0, rate, c.rate_turnps_q28)
    c.step += 1
    c.rate_turnps_q28 = rate
    flags = (
        (FLAG_GYRO_CLAMPED if gyro_clamped else 0)
        | (FLAG_ACCEL_Y_CLAMPED if y_clamped else 0)
        | (FLAG_ACCEL_Z_CLAMPED if z_clamped else 0)
    )
    if flags:
        c.clamped_steps += 1

    variance = kernels.tilt_variance(p, accel_y, accel_z)
    measured = kernels.tilt_angle(p, accel_y, accel_z)

    kernels.kalman_step(k, p, variance, measured, driving)
    tilt_turn_q32, bias = kernels.kalman_tilt(k), kernels.kalman_bias(k, p)
    rate_corrected = rate - bias
    error = wrap_i32(setpoint_turn_q32 - tilt_turn_q32)

    kernels.pid_step(pid, p, error, rate_corrected)
    pulse_halfus = pulses(p, pid.command_q22)
    if pid.excess_q22 != 0:
        flags |= FLAG_COMMAND_LIMITED
    return (
        *raw, setpoint_turn_q32, rate, accel_y, accel_z, measured, variance, *k.words(),
        tilt_turn_q32, bias, rate_corrected, c.clamped_steps, *pid.words(), *pulse_halfus, flags, c.step,
    )  # fmt: skip


def control_retune(c: QuadState, old: Params, new: Params) -> None:
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

"""`balancer` in integers: raw counts to the duty of the motor's bridge (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed import kernels, plausibility, validity
from plumb.kernels.fixed.kernels import KalmanState, Params, PidState
from plumb.kernels.integers import Integer, clamp, select, wrap_i32

FLAG_COMMAND_LIMITED, FLAG_WHEEL_CLAMPED, FLAG_LEAN_LIMITED = 1 << 3, 1 << 4, 1 << 5
FLAG_SETPOINT_CLAMPED, FLAG_FALLEN = 1 << 6, 1 << 7
WHEEL_ACCEL_LIMIT_G_Q24 = 3 << 24


@dataclass(slots=True)
class ControlState:
    kalman: KalmanState
    speed: PidState = field(default_factory=PidState)
    pid: PidState = field(default_factory=PidState)
    hall: Integer = 0
    velocity_mps_q26: Integer = 0
    rate_turnps_q28: Integer = 0
    clamped_steps: Integer = 0
    fallen: Integer = 0
    tilt_turn_q32: Integer = 0
    blind: Integer = 0
    """1: the accelerometer is not believed, the tilt measured is the one estimated in the step before."""
    step: int = 0


def wheel(edges: Integer, velocity: Integer, p: Params) -> tuple[Integer, Integer, Integer, Integer]:
    """Speed of this step and filtered velocity, m/s Q26; acceleration, g Q26; and 1 if a value was clamped, else 0."""
    used = clamp(edges, -p["wheel.edges_max"], p["wheel.edges_max"])
    speed = used * p["wheel.edge_mps_q26"]
    change = speed - velocity
    accel_q24 = (change * p["wheel.accel_gain_q30"]) >> 32
    limited_q24 = clamp(accel_q24, -WHEEL_ACCEL_LIMIT_G_Q24, WHEEL_ACCEL_LIMIT_G_Q24)
    clamped = select((used != edges) | (limited_q24 != accel_q24), 1, 0)
    return speed, velocity + 2 * ((change * p["wheel.alpha_q31"]) >> 32), limited_q24 * 4, clamped


def control_init(p: Params) -> ControlState:
    return ControlState(kernels.kalman_init(p))


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint_mps_q26: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step += 1
    edges = raw[3] * 0 if c.step == 1 else ((raw[3] - c.hall + 0x8000) & 0xFFFF) - 0x8000
    previous, c.hall = c.rate_turnps_q28, raw[3]
    rate, gyro_clamped = kernels.calibrate(raw[0], p, "gyro")
    accel_x, x_clamped = kernels.calibrate(raw[1], p, "accel")
    accel_z, z_clamped = kernels.calibrate(raw[2], p, "accel_up")
    speed, velocity, wheel_accel, wheel_clamped = wheel(edges, c.velocity_mps_q26, p)
    c.rate_turnps_q28, c.velocity_mps_q26 = rate, velocity
    u = rate if c.step == 1 else kernels.driving_rate(p, rate, previous)
    gravity_x = accel_x + wheel_accel
    measured = select(c.blind == 1, c.tilt_turn_q32, kernels.tilt(gravity_x, accel_z, p))
    variance = kernels.trust(gravity_x, accel_z, p)
    k, lean_pid, pid = c.kalman, c.speed, c.pid
    kernels.kalman_step(k, p, variance, measured, u)
    tilt_turn_q32, bias = kernels.kalman_tilt(k), kernels.kalman_bias(k, p)
    c.tilt_turn_q32 = tilt_turn_q32
    rate_corrected = rate - bias

    wanted = clamp(setpoint_mps_q26, -p["drive.speed_max_mps_q26"], p["drive.speed_max_mps_q26"])
    speed_error = wanted - velocity
    kernels.pid_step(lean_pid, p, speed_error, wheel_accel, "speed")
    lean = (lean_pid.command_q22 * 256 * p["drive.lean_max_turn_q34"]) >> 32
    error = wrap_i32(lean - tilt_turn_q32)
    kernels.pid_step(pid, p, error, rate_corrected)

    c.fallen = select((c.fallen == 1) | (abs(tilt_turn_q32) > p["drive.fall_turn_q32"]), 1, 0)
    duty = ((pid.command_q22 >> 6) * p["drive.span_q15"] + (1 << 15)) >> 16
    duty = select(c.fallen == 1, 0, clamp(duty, -p["drive.duty_max_q15"], p["drive.duty_max_q15"]))

    flags = gyro_clamped | x_clamped << 1 | z_clamped << 2 | wheel_clamped * FLAG_WHEEL_CLAMPED
    c.clamped_steps = c.clamped_steps + select(flags != 0, 1, 0)
    flags = flags | select(wanted != setpoint_mps_q26, FLAG_SETPOINT_CLAMPED, 0)
    flags = flags | select(lean_pid.excess_q22 != 0, FLAG_LEAN_LIMITED, 0)
    flags = flags | select(pid.excess_q22 != 0, FLAG_COMMAND_LIMITED, 0) | c.fallen * FLAG_FALLEN
    return (
        *raw, setpoint_mps_q26, rate, accel_x, accel_z, speed, velocity, wheel_accel, gravity_x, measured, variance,
        k.tilt_turn_q61, k.bias_turn_q61, k.p00, k.p01, k.p11, k.p11_frac_q30,
        k.innovation_turn_q32, k.k0_q29, k.k1_q29,
        tilt_turn_q32, bias, rate_corrected, c.clamped_steps,
        lean_pid.integral_q54, lean_pid.command_q22, lean_pid.rate_filtered_turnps_q27, lean_pid.excess_q22,
        speed_error,
        pid.integral_q54, pid.command_q22, pid.rate_filtered_turnps_q27, pid.excess_q22, error,
        lean, duty, flags, c.step,
    )  # fmt: skip


def control_retune(c: ControlState, old: Params, new: Params) -> None:
    """Other gains from the next step on."""
    kernels.pid_retune(c.speed, old, new, "speed")
    kernels.pid_retune(c.pid, old, new)


def control_valid(p: Params) -> bool:
    channels = all(validity.calibration(p, group) for group in ("gyro", "accel", "accel_up"))
    filters = validity.wheel(p) and validity.tilt(p) and validity.kalman(p)
    return channels and filters and validity.pid(p, "speed") and validity.pid(p) and _drive_valid(p)


def _drive_valid(p: Params) -> bool:
    within = (("speed_max_mps_q26", 0, 8 << 26), ("lean_max_turn_q34", 0, 1 << 30), ("span_q15", -32767, 32767),
              ("duty_max_q15", 0, 32767), ("fall_turn_q32", 0, 1 << 31))  # fmt: skip
    return all(low <= int(p[f"drive.{name}"]) <= high for name, low, high in within)


PLAUSIBLE = plausibility.Bounds(
    setpoint="setpoint_mps_q26",
    accel=("accel_x_g_q26", "accel_z_g_q26"),
    accel_g2_q20=(round(0.4**2 * 2**20), round(1.8**2 * 2**20)),
    rest_g2_q20=(round(0.9**2 * 2**20), round(1.1**2 * 2**20)),
    rest_turnps_q28=round(10.0 / 360.0 * 2**28),
    uneven_turn_q32=round(30.0 / 360.0 * 2**32),
    ready_turn_q32=round(10.0 / 360.0 * 2**32),
)

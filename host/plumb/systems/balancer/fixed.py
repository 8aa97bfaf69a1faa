"""`balancer` in integers: raw counts to the duty of the motor's bridge (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed import kernels, plausibility, validity
from plumb.kernels.fixed.kernels import KalmanState, Params, PidState
from plumb.kernels.integers import clamp, mulhi_i32, wrap_i16, wrap_i32
from plumb.spec import declarations

(
    FLAG_GYRO_CLAMPED, FLAG_ACCEL_X_CLAMPED, FLAG_ACCEL_Z_CLAMPED, FLAG_COMMAND_LIMITED, FLAG_WHEEL_CLAMPED,
    FLAG_LEAN_LIMITED, FLAG_SETPOINT_CLAMPED, FLAG_FALLEN,
) = (1 << bit for bit in range(8))  # fmt: skip
WHEEL_ACCEL_LIMIT_G_Q24 = 3 << 24


@dataclass(slots=True)
class Wheel:
    """Speed of the step, filtered velocity and acceleration. Words of the record, in order."""

    speed_mps_q26: int = 0
    velocity_mps_q26: int = 0
    accel_g_q26: int = 0

    def words(self) -> tuple[int, ...]:
        return self.speed_mps_q26, self.velocity_mps_q26, self.accel_g_q26


@dataclass(slots=True)
class BalancerState:
    kalman: KalmanState
    wheel: Wheel = field(default_factory=Wheel)
    speed: PidState = field(default_factory=PidState)
    pid: PidState = field(default_factory=PidState)
    hall: int = 0
    rate_turnps_q28: int = 0
    accel_z_g_q26: int = 0
    tilt_measured_turn_q32: int = 0
    tilt_turn_q32: int = 0
    rate_corrected_turnps_q28: int = 0
    clamped_steps: int = 0
    duty_q15: int = 0
    flags: int = 0
    step: int = 0
    blind: bool = False
    """The accelerometer is not believed, the tilt measured is the one estimated in the step before."""


def control_init(p: Params) -> BalancerState:
    return BalancerState(kernels.kalman_init(p))


def wheel_step(c: Wheel, p: Params, edges: int) -> bool:
    """Speed, velocity and acceleration from the edges of a step; returns whether a value was clamped."""
    used = clamp(edges, -p["wheel.edges_max"], p["wheel.edges_max"])
    c.speed_mps_q26 = used * p["wheel.edge_mps_q26"]
    change = c.speed_mps_q26 - c.velocity_mps_q26
    c.velocity_mps_q26 += 2 * mulhi_i32(change, p["wheel.alpha_q31"])
    accel_q24 = mulhi_i32(change, p["wheel.accel_gain_q30"])
    limited_q24 = clamp(accel_q24, -WHEEL_ACCEL_LIMIT_G_Q24, WHEEL_ACCEL_LIMIT_G_Q24)
    c.accel_g_q26 = limited_q24 * 4
    return used != edges or limited_q24 != accel_q24


def control_step(c: BalancerState, p: Params, raw: Sequence[int], setpoint_mps_q26: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    k, wheel, speed, pid = c.kalman, c.wheel, c.speed, c.pid
    first = c.step == 0
    edges = 0 if first else wrap_i16(raw[3] - c.hall)
    c.hall = raw[3]

    rate, gyro_clamped = kernels.calibration_apply(p, "gyro", raw[0])
    accel_x, x_clamped = kernels.calibration_apply(p, "accel", raw[1])
    accel_z, z_clamped = kernels.calibration_apply(p, "accel_up", raw[2])
    wheel_clamped = wheel_step(wheel, p, edges)
    flags = (
        (FLAG_GYRO_CLAMPED if gyro_clamped else 0)
        | (FLAG_ACCEL_X_CLAMPED if x_clamped else 0)
        | (FLAG_ACCEL_Z_CLAMPED if z_clamped else 0)
        | (FLAG_WHEEL_CLAMPED if wheel_clamped else 0)
    )
    driving = kernels.driving_rate(p, first, rate, c.rate_turnps_q28)
    gravity_x = accel_x + wheel.accel_g_q26
    c.step += 1
    c.rate_turnps_q28 = rate
    c.accel_z_g_q26 = accel_z
    if flags:
        c.clamped_steps += 1

    variance = kernels.tilt_variance(p, gravity_x, accel_z)
    measured = c.tilt_turn_q32 if c.blind else kernels.tilt_angle(p, gravity_x, accel_z)
    c.tilt_measured_turn_q32 = measured

    kernels.kalman_step(k, p, variance, measured, driving)
    tilt_turn_q32, bias = kernels.kalman_tilt(k), kernels.kalman_bias(k, p)
    c.tilt_turn_q32 = tilt_turn_q32
    rate_corrected = c.rate_corrected_turnps_q28 = rate - bias

    wanted = clamp(setpoint_mps_q26, -p["drive.speed_max_mps_q26"], p["drive.speed_max_mps_q26"])
    kernels.pid_step(speed, p, wanted - wheel.velocity_mps_q26, wheel.accel_g_q26, "speed")
    lean_turn_q32 = mulhi_i32(speed.command_q22 * 256, p["drive.lean_max_turn_q34"])

    kernels.pid_step(pid, p, wrap_i32(lean_turn_q32 - tilt_turn_q32), rate_corrected)

    fallen = c.flags & FLAG_FALLEN != 0 or abs(tilt_turn_q32) > p["drive.fall_turn_q32"]
    duty = ((pid.command_q22 >> 6) * p["drive.span_q15"] + (1 << 15)) >> 16
    c.duty_q15 = 0 if fallen else clamp(duty, -p["drive.duty_max_q15"], p["drive.duty_max_q15"])
    if wanted != setpoint_mps_q26:
        flags |= FLAG_SETPOINT_CLAMPED
    if speed.excess_q22 != 0:
        flags |= FLAG_LEAN_LIMITED
    if pid.excess_q22 != 0:
        flags |= FLAG_COMMAND_LIMITED
    if fallen:
        flags |= FLAG_FALLEN
    c.flags = flags
    return (
        *raw, setpoint_mps_q26, rate, accel_x, accel_z, *wheel.words(), gravity_x, measured, variance, *k.words(),
        tilt_turn_q32, bias, rate_corrected, c.clamped_steps, *speed.words(), *pid.words(), lean_turn_q32, c.duty_q15,
        flags, c.step,
    )  # fmt: skip


def control_retune(c: BalancerState, old: Params, new: Params) -> None:
    """Other gains from the next step on."""
    kernels.pid_retune(c.speed, old, new, "speed")
    kernels.pid_retune(c.pid, old, new)


def control_valid(p: Params) -> bool:
    channels = all(validity.calibration(p, group) for group in ("gyro", "accel", "accel_up"))
    filters = validity.wheel(p) and validity.tilt(p) and validity.kalman(p)
    rows = declarations.system("balancer").parameters
    within = all(row["min"] <= p[row["name"]] <= row["max"] for row in rows)
    return channels and filters and validity.pid(p, "speed") and validity.pid(p) and within


PLAUSIBLE = plausibility.Bounds(
    setpoint="setpoint_mps_q26",
    accel=("accel_x_g_q26", "accel_z_g_q26"),
    accel_g2_q20=(round(0.4**2 * 2**20), round(1.8**2 * 2**20)),
    rest_g2_q20=(round(0.9**2 * 2**20), round(1.1**2 * 2**20)),
    rest_turnps_q28=round(10.0 / 360.0 * 2**28),
    uneven_turn_q32=round(30.0 / 360.0 * 2**32),
    ready_turn_q32=round(10.0 / 360.0 * 2**32),
)

"""`balancer` in float64: from counts to the duty of the bridge."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference import kernels
from plumb.kernels.reference.kernels import KalmanState, Number, PidState
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Pid
from plumb.systems.balancer.settings import SpeedLoop, Wheel
from plumb.systems.balancer.tuning import BalancerTuning, most_edges

GRAVITY_MPS2 = 9.80665


@dataclass
class WheelState:
    """Hall count of the previous step (None before the first), and the filtered velocity."""

    hall: Number = None
    velocity_mps: Number = 0.0


def wheel_step(c: WheelState, settings: Wheel, period_s: float, hall: Number) -> tuple[Number, Number, Number]:
    """From the wrapping count of Hall edges: speed of this step and filtered velocity in m/s, and the acceleration of
    the axle in g: accel_share of the slope of the filtered velocity."""
    edges = 0.0 * hall if c.hall is None else (hall - c.hall + 32768.0) % 65536.0 - 32768.0
    c.hall = hall
    most = most_edges(settings, period_s)
    speed = kernels.clip(edges, -most, most) * settings.edge_m / period_s
    share = 1.0 - math.exp(-period_s / settings.tau_s) if settings.tau_s else 1.0
    slope = share * (speed - c.velocity_mps) / period_s
    c.velocity_mps = c.velocity_mps + share * (speed - c.velocity_mps)
    return speed, c.velocity_mps, kernels.clip(settings.accel_share * slope / GRAVITY_MPS2, -3.0, 3.0)


def wheel(hall: FloatArray, settings: Wheel, period_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`wheel_step` for a whole run: speed, velocity and acceleration, (steps[, runs])."""
    c = WheelState()
    rows = np.array([wheel_step(c, settings, period_s, now) for now in hall], np.float64)
    speed, velocity, accel_g = np.moveaxis(rows.reshape(len(hall), 3, *hall.shape[1:]), 1, 0)
    return speed, velocity, accel_g


def cruise(settings: SpeedLoop) -> Pid:
    """The speed loop as a PID that commands a fraction of the largest lean; its "deg" are m/s, its "deg/s" g."""
    most = settings.lean_max_deg
    return Pid(
        kp_per_deg=settings.lean_deg_per_mps / most,
        ki_per_deg_s=settings.lean_deg_per_m / most,
        kd_per_dps=settings.lean_deg_per_g / most,
        derivative_tau_s=settings.accel_tau_s,
        slew_per_s=settings.lean_slew_dps / most,
    )


@dataclass
class BalancerReferenceState:
    kalman: KalmanState
    speed: PidState = field(default_factory=PidState)
    pid: PidState = field(default_factory=PidState)
    fallen: Number = 0.0


def control_step(
    c: BalancerReferenceState, tuning: BalancerTuning, rate_dps: Number, z_deg: Number, r_deg2: Number,
    velocity_mps: Number, accel_g: Number, setpoint_mps: Number,
) -> dict[str, Number]:  # fmt: skip
    """The parts of a step with state, except the wheel's: filter, speed loop and balance loop."""
    kernels.kalman_step(c.kalman, tuning.kalman, tuning.period_s, z_deg, rate_dps, r_deg2)
    bias_dps = kernels.clip(c.kalman.bias_dps, -tuning.kalman.bias_max_dps, tuning.kalman.bias_max_dps)
    corrected_dps = rate_dps - bias_dps

    most = tuning.speed.speed_max_mps
    speed_error = kernels.clip(setpoint_mps, -most, most) - velocity_mps
    kernels.pid_step(c.speed, cruise(tuning.speed), tuning.period_s, speed_error, accel_g)
    lean_deg = tuning.speed.lean_max_deg * c.speed.command

    error_deg = kernels.wrap(lean_deg - c.kalman.tilt_deg)
    kernels.pid_step(c.pid, tuning.pid, tuning.period_s, error_deg, corrected_dps)

    drive = tuning.drive
    c.fallen = np.maximum(c.fallen, abs(c.kalman.tilt_deg) > drive.fall_deg)
    duty = kernels.clip(drive.span * c.pid.command, -drive.duty_max, drive.duty_max) * (1.0 - c.fallen)
    return {
        "tilt_deg": c.kalman.tilt_deg,
        "bias_dps": bias_dps,
        "innovation_deg": c.kalman.innovation_deg,
        "rate_corrected_dps": corrected_dps,
        "lean_deg": lean_deg,
        "error_deg": error_deg,
        "command": c.pid.command,
        "duty": duty,
    }


def run_control(
    tuning: BalancerTuning, raw: npt.ArrayLike, setpoint_mps_q26: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to duty. raw: (steps, 4 or more[, runs]); setpoint: (steps[, runs]), default 0 (standing).

    Returns float arrays (steps[, runs]) by name: rate_dps, accel_x_g, accel_z_g, speed_mps, velocity_mps,
    wheel_accel_g, tilt_measured_deg, r_deg2, and those of `control_step`.
    """
    counts = np.asarray(raw, np.float64)
    shape = (counts.shape[0], *counts.shape[2:])
    asked = np.zeros(shape) if setpoint_mps_q26 is None else np.asarray(setpoint_mps_q26, np.float64) / 2**26
    rate_dps = kernels.calibrate(counts[:, 0], tuning.calibration.gyro)
    accel_x_g = kernels.calibrate(counts[:, 1], tuning.calibration.accel)
    accel_z_g = kernels.calibrate(counts[:, 2], tuning.calibration.accel_up)
    speed_mps, velocity_mps, wheel_accel_g = wheel(counts[:, 3], tuning.wheel, tuning.period_s)
    z_deg = kernels.tilt(accel_x_g + wheel_accel_g, accel_z_g, tuning.tilt)
    r_deg2 = kernels.trust(accel_x_g + wheel_accel_g, accel_z_g, tuning.trust)

    c = BalancerReferenceState(kernels.kalman_init(tuning.start))
    series = (rate_dps, z_deg, r_deg2, velocity_mps, wheel_accel_g, asked)
    inputs = [values.tolist() if values.ndim == 1 else values for values in series]
    steps = [control_step(c, tuning, *now) for now in zip(*inputs, strict=True)]
    outputs = {name: np.array([step[name] for step in steps]) for name in (steps[0] if steps else ())}
    return {
        "rate_dps": rate_dps,
        "accel_x_g": accel_x_g,
        "accel_z_g": accel_z_g,
        "speed_mps": speed_mps,
        "velocity_mps": velocity_mps,
        "wheel_accel_g": wheel_accel_g,
        "tilt_measured_deg": z_deg,
        "r_deg2": r_deg2,
        **outputs,
    }

"""`quad` in float64: from counts to pulses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference import kernels
from plumb.kernels.reference.kernels import KalmanState, Number, PidState
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Esc
from plumb.systems.quad.tuning import QuadTuning


def esc(command: Number, settings: Esc) -> tuple[Number, Number]:
    """Pulses of the two opposing motors in us."""
    swing = settings.span_us * command
    return (
        kernels.clip(settings.mid_us + swing, settings.min_us, settings.max_us),
        kernels.clip(settings.mid_us - swing, settings.min_us, settings.max_us),
    )


@dataclass
class QuadReferenceState:
    kalman: KalmanState
    pid: PidState = field(default_factory=PidState)


def control_step(
    c: QuadReferenceState,
    tuning: QuadTuning,
    rate_dps: Number,
    z_deg: Number,
    r_deg2: Number,
    setpoint_deg: Number,
) -> dict[str, Number]:
    """The parts of a step with state: the filter on the measured tilt z, then the controller."""
    kernels.kalman_step(c.kalman, tuning.kalman, tuning.period_s, z_deg, rate_dps, r_deg2)
    error_deg = kernels.wrap(setpoint_deg - c.kalman.tilt_deg)
    bias_dps = kernels.clip(c.kalman.bias_dps, -tuning.kalman.bias_max_dps, tuning.kalman.bias_max_dps)
    corrected_dps = rate_dps - bias_dps
    kernels.pid_step(c.pid, tuning.pid, tuning.period_s, error_deg, corrected_dps)
    pulse_us = esc(c.pid.command, tuning.esc)
    return {
        "tilt_deg": c.kalman.tilt_deg,
        "bias_dps": bias_dps,
        "innovation_deg": c.kalman.innovation_deg,
        "rate_corrected_dps": corrected_dps,
        "error_deg": error_deg,
        "command": c.pid.command,
        "pulse_0_us": pulse_us[0],
        "pulse_1_us": pulse_us[1],
    }


def run_filter(tuning: QuadTuning, raw: npt.ArrayLike) -> dict[str, FloatArray]:
    """The filter alone, which needs no controller behind it: `tilt_deg` and `bias_dps` of `run_control`, (steps[,
    runs]), in half of its time. raw: (steps, 3 or more[, runs])."""
    rate_dps, _, _, z_deg, r_deg2 = _measured(tuning, np.asarray(raw, np.float64))
    x, most_dps = kernels.kalman_init(tuning.start), tuning.kalman.bias_max_dps
    tilt_deg, bias_dps = np.empty_like(z_deg), np.empty_like(z_deg)
    for k in range(len(z_deg)):
        kernels.kalman_step(x, tuning.kalman, tuning.period_s, z_deg[k], rate_dps[k], r_deg2[k])
        tilt_deg[k], bias_dps[k] = x.tilt_deg, x.bias_dps
    return {"tilt_deg": tilt_deg, "bias_dps": np.asarray(kernels.clip(bias_dps, -most_dps, most_dps))}


def _measured(tuning: QuadTuning, counts: FloatArray) -> tuple[FloatArray, ...]:
    """Rate in deg/s, acceleration along y and z in g, tilt in deg, R in deg^2, (steps[, runs]) each."""
    rate_dps = kernels.calibrate(counts[:, 0], tuning.calibration.gyro)
    accel_y_g = kernels.calibrate(counts[:, 1], tuning.calibration.accel)
    accel_z_g = kernels.calibrate(counts[:, 2], tuning.calibration.accel_up)
    z_deg = kernels.tilt(accel_y_g, accel_z_g, tuning.tilt)
    return rate_dps, accel_y_g, accel_z_g, z_deg, kernels.trust(accel_y_g, accel_z_g, tuning.trust)


def run_control(
    tuning: QuadTuning, raw: npt.ArrayLike, setpoint_turn_q32: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to pulses. raw: (steps, 3 or more[, runs]); setpoint: (steps[, runs]), default 0 (level).

    Returns float arrays (steps[, runs]) by name: rate_dps, accel_y_g, accel_z_g, tilt_measured_deg, r_deg2, and those
    of `control_step`.
    """
    counts = np.asarray(raw, np.float64)
    shape = (counts.shape[0], *counts.shape[2:])
    turns = np.zeros(shape) if setpoint_turn_q32 is None else np.asarray(setpoint_turn_q32, np.float64) / 2**32
    rate_dps, accel_y_g, accel_z_g, z_deg, r_deg2 = _measured(tuning, counts)

    c = QuadReferenceState(kernels.kalman_init(tuning.start))
    inputs = [values.tolist() if values.ndim == 1 else values for values in (rate_dps, z_deg, r_deg2, 360.0 * turns)]
    steps = [control_step(c, tuning, *now) for now in zip(*inputs, strict=True)]
    outputs = {name: np.array([step[name] for step in steps]) for name in (steps[0] if steps else ())}
    return {
        "rate_dps": rate_dps,
        "accel_y_g": accel_y_g,
        "accel_z_g": accel_z_g,
        "tilt_measured_deg": z_deg,
        "r_deg2": r_deg2,
        **outputs,
    }

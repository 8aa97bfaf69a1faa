"""Metrics and plots of a run of `quad`."""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.proof import metrics as measures
from plumb.proof.report import (
    ESTIMATE,
    SECOND,
    SENSOR,
    TRUTH,
    Line,
    Plot,
    Series,
    error_and_band,
    error_budget,
    of_band,
)
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.systems.quad.scenarios import OFFSET_G
from plumb.tuning.variances import lsb_of

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

TURN_DEG = 360.0 / 2.0**32
"""Degrees per unit of a binary angle."""
RATE_DPS = 360.0 / 2.0**28
"""Degrees per second in a unit of a rate word."""
COMMAND = 2.0**-22
PRESCRIBED_WITHIN_DEG = 0.01
"""A prescribed motion is its own setpoint, but for rounding."""


def estimate_deg(run: Run) -> FloatArray:
    """The board's tilt in deg, (steps,)."""
    return np.asarray(run.board_words["tilt_turn_q32"] * TURN_DEG)


def accel_only_deg(run: Run) -> FloatArray:
    """Tilt in deg from the accelerometer alone, (steps,)."""
    y, z = (run.words[name].astype(np.float64) for name in ("accel_y_g_q26", "accel_z_g_q26"))
    return measures.accel_only_deg(y, z)


def two_sigma_deg(run: Run) -> FloatArray:
    """Twice the standard deviation of the tilt, (steps,): the filter's own, and that of the accelerometer's offset."""
    return measures.with_offset(measures.two_sigma(run.board_words["p00"], lsb_of(run.params)), OFFSET_G)


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of the tilt, as plumb.proof.metrics defines them; None for a run without scored samples."""
    apart = measures.wrap_deg(run.words["tilt_turn_q32"] * TURN_DEG - run.reference["tilt_deg"])
    scored, some = run.inputs.scored, bool(run.inputs.scored.any())
    truth_deg = run.inputs.truth["tilt_deg"][scored]
    error_deg = measures.wrap_deg(estimate_deg(run)[scored] - truth_deg)
    accel_deg = measures.wrap_deg(accel_only_deg(run)[scored] - truth_deg)
    return {
        "angle_rmse_deg": float(measures.rms(error_deg)) if some else None,
        "angle_max_deg": float(np.max(np.abs(error_deg))) if some else None,
        "accel_only_rmse_deg": float(measures.rms(accel_deg)) if some else None,
        "fixed_vs_reference_max_deg": float(np.max(np.abs(apart))),
        "bias_settled_s": bias_settled_s(run),
        **consistency(run, error_deg),
        **apart_from_setpoint(run),
    }


def apart_from_setpoint(run: Run) -> dict[str, float | None]:
    """How far the axis is from its setpoint over the second half of the run; {} where it follows a prescribed motion
    that is its setpoint, or has no true tilt."""
    late = slice(len(run.inputs.raw) // 2, None)
    error_deg = measures.wrap_deg((run.inputs.truth["tilt_deg"] - run.inputs.setpoint * TURN_DEG)[late])
    if not np.isfinite(error_deg).all() or not np.any(np.abs(error_deg) > PRESCRIBED_WITHIN_DEG):
        return {}
    return {"setpoint_rmse_deg": float(np.sqrt(np.mean(error_deg * error_deg)))}


def consistency(run: Run, error_deg: FloatArray) -> dict[str, float | None]:
    """Mean and spread of the error over the scored samples, and the spread compared with the filter's own sigma; {} for
    a run without scored samples or without truth."""
    if not len(error_deg) or not np.isfinite(error_deg).all():
        return {}
    variance = run.board_words["p00"][run.inputs.scored]
    return measures.Consistency.of_errors(error_deg, variance, lsb_of(run.params)).to_metrics()


def bias_settled_s(run: Run) -> float | None:
    """Time until the bias stays within 1 deg/s of the true one, in s; None if it never does or has no true value."""
    error_dps = run.board_words["bias_turnps_q28"] * RATE_DPS - run.inputs.truth["bias_dps"]
    if not np.isfinite(error_dps).all():
        return None
    settled_s = measures.settled_s(error_dps, run.params.period_s)
    return settled_s if np.isfinite(settled_s) else None


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Tilt (and setpoint, in a closed loop), estimation error, bias, control and PWM, fixed point against float64."""
    time_s, words, truth = run.inputs.time_s, run.words, run.inputs.truth["tilt_deg"]
    error = measures.wrap_deg(estimate_deg(run) - truth)
    apart = measures.wrap_deg(words["tilt_turn_q32"] * TURN_DEG - run.reference["tilt_deg"])
    bias = [Line("estimated", words["bias_turnps_q28"] * RATE_DPS, ESTIMATE)]
    if np.isfinite(run.inputs.truth["bias_dps"]).any():
        bias.insert(0, Line("true", run.inputs.truth["bias_dps"], TRUTH))
    tilt = [Line("accelerometer only", accel_only_deg(run), SENSOR, 0.7)]
    if closed:
        tilt.append(Line("setpoint", run.inputs.setpoint * TURN_DEG, SECOND))
    if np.isfinite(truth).any():
        tilt.append(Line("true", truth, TRUTH, 1.6))
    band = two_sigma_deg(run)
    tilt.append(Line("estimate ± 2 sigma", estimate_deg(run), ESTIMATE, band=band))
    found = [
        Plot("Tilt", "deg", time_s, tilt, of_band(OFFSET_G)),
        Plot("Gyro bias", "deg/s", time_s, bias),
        Plot("Command of the PID", "1 = full", time_s, [Line("command", words["command_q22"] * COMMAND, ESTIMATE)]),
        Plot(
            "Pulses to the two speed controllers",
            "us",
            time_s,
            [
                Line("motor 0", words["pulse_halfus_0"] / 2.0, ESTIMATE),
                Line("motor 1", words["pulse_halfus_1"] / 2.0, SECOND),
            ],
        ),
        error_budget(time_s, apart),
    ]
    if np.isfinite(truth).any():
        found.insert(1, error_and_band(time_s, error, band, OFFSET_G))
    return found


def rms_and_max(run: Run, tilt_deg: Series) -> tuple[float, float]:
    """rms and largest error of an estimate over the scored samples, deg."""
    truth, scored = run.inputs.truth["tilt_deg"], run.inputs.scored
    return (
        float(measures.angle_rmse_deg(np.asarray(tilt_deg, np.float64), truth, scored)),
        float(measures.angle_max_deg(np.asarray(tilt_deg, np.float64), truth, scored)),
    )

"""Metrics and plots of a run of `wheels`."""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.proof import metrics as measures
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, error_budget
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

TURN_DEG, RATE_DPS, VELOCITY_MPS, DUTY = 360.0 / 2.0**32, 360.0 / 2.0**28, 2.0**-26, 2.0**-15


def estimate_deg(run: Run) -> FloatArray:
    """The board's tilt in deg, (steps,)."""
    return np.asarray(run.board_words["tilt_turn_q32"] * TURN_DEG)


def accel_only_deg(run: Run) -> FloatArray:
    """Tilt in deg from the accelerometer alone, (steps,)."""
    x, z = (run.words[name].astype(np.float64) for name in ("accel_x_g_q26", "accel_z_g_q26"))
    return measures.accel_only_deg(x, z)


def apart_deg(run: Run) -> FloatArray:
    """Fixed point less float64, deg, (steps,)."""
    return np.asarray(measures.wrap_deg(run.words["tilt_turn_q32"] * TURN_DEG - run.reference["tilt_deg"]))


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of tilt, velocity and turn rate over the scored samples, and the largest true tilt."""
    truth, words, scored = run.inputs.truth, run.board_words, run.inputs.scored

    def rms(values: FloatArray, true: FloatArray) -> float | None:
        return float(np.sqrt(np.mean((values - true)[scored] ** 2))) if scored.any() else None

    def angle_rms(values: FloatArray) -> float | None:
        return float(measures.angle_rmse_deg(values, truth["tilt_deg"], scored)) if scored.any() else None

    tilt = estimate_deg(run)
    return {
        "angle_rmse_deg": angle_rms(tilt),
        "angle_max_deg": float(measures.angle_max_deg(tilt, truth["tilt_deg"], scored)) if scored.any() else None,
        "accel_only_rmse_deg": angle_rms(accel_only_deg(run)),
        "fixed_vs_reference_max_deg": float(np.max(np.abs(apart_deg(run)))),
        "velocity_rmse_mps": rms(truth["velocity_mps"], np.asarray(words["asked_mps_q26"] * VELOCITY_MPS)),
        "turn_rmse_dps": rms(truth["turn_dps"], np.asarray(words["asked_turnps_q28"] * RATE_DPS)),
        "tilt_max_deg": float(np.max(np.abs(truth["tilt_deg"]))),
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Tilt, velocity, turn rate, duties, and fixed point against float64."""
    time_s, words, truth = run.inputs.time_s, run.board_words, run.inputs.truth
    tilt = [
        Line("accelerometer only", accel_only_deg(run), SENSOR, 0.7),
        Line("true", truth["tilt_deg"], TRUTH, 1.6),
        Line("estimate", estimate_deg(run), ESTIMATE),
    ]
    if closed:
        tilt.insert(1, Line("lean asked for", words["lean_turn_q32"] * TURN_DEG, SECOND))
    velocity = [
        Line("asked for", words["asked_mps_q26"] * VELOCITY_MPS, SECOND),
        Line("true", truth["velocity_mps"], TRUTH, 1.6),
        Line("from the encoders, filtered", words["velocity_mps_q26"] * VELOCITY_MPS, ESTIMATE),
    ]
    turn = [
        Line("asked for", words["asked_turnps_q28"] * RATE_DPS, SECOND),
        Line("true", truth["turn_dps"], TRUTH, 1.6),
        Line("gyro less bias", words["turn_rate_turnps_q28"] * RATE_DPS, ESTIMATE),
    ]
    duties = [
        Line("left", words["duty_left_q15"] * DUTY, ESTIMATE),
        Line("right", words["duty_right_q15"] * DUTY, SECOND),
    ]
    error_deg = measures.wrap_deg(estimate_deg(run) - truth["tilt_deg"])
    return [
        Plot("Tilt", "deg", time_s, tilt),
        Plot("Error of the tilt", "deg", time_s, [Line("estimate less true", error_deg, ESTIMATE)]),
        Plot("Velocity", "m/s", time_s, velocity),
        Plot("Turn rate", "deg/s", time_s, turn),
        Plot("Duties", "1 = full", time_s, duties),
        error_budget(time_s, apart_deg(run)),
    ]

"""Metrics and plots of a run of `balancer`."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.judging import angles
from plumb.proof import metrics as measures
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, error_and_band, error_budget, of_band
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer.scenarios import OFFSET_G
from plumb.tuning.variances import lsb_of

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

Series = npt.NDArray[np.floating[Any]]  # Any: of any width

TURN_DEG = 360.0 / 2.0**32
RATE_DPS = 360.0 / 2.0**28
VELOCITY_MPS = 2.0**-26
DUTY = 2.0**-15
FLAG_FALLEN = 1 << 7


def estimate_deg(run: Run) -> FloatArray:
    """The board's tilt in deg, (steps,)."""
    return np.asarray(run.board_words["tilt_turn_q32"] * TURN_DEG)


def accel_only_deg(run: Run) -> FloatArray:
    """Tilt in deg from the accelerometer alone, (steps,)."""
    x, z = (run.words[name].astype(np.float64) for name in ("accel_x_g_q26", "accel_z_g_q26"))
    return measures.accel_only_deg(x, z)


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of tilt and rate over the scored samples, the largest true tilt, and the time the vehicle lay on the
    ground."""
    truth, words, scored = run.inputs.truth, run.board_words, run.inputs.scored

    def rms(values: Series, true: Series) -> float | None:
        return float(np.sqrt(np.mean((values - true)[scored] ** 2))) if scored.any() else None

    def angle_rms(values: FloatArray) -> float | None:
        return float(measures.angle_rmse_deg(values, truth["tilt_deg"], scored)) if scored.any() else None

    tilt = estimate_deg(run)
    known = scored.any() and np.isfinite(truth["tilt_deg"][scored]).all()
    apart = measures.wrap_deg(run.words["tilt_turn_q32"] * TURN_DEG - run.reference["tilt_deg"])
    return {
        "angle_rmse_deg": angle_rms(tilt),
        "angle_max_deg": float(measures.angle_max_deg(tilt, truth["tilt_deg"], scored)) if scored.any() else None,
        "accel_only_rmse_deg": angle_rms(accel_only_deg(run)),
        "fixed_vs_reference_max_deg": float(np.max(np.abs(apart))),
        "rate_rmse_dps": rms(words["rate_corrected_turnps_q28"] * RATE_DPS, truth["rate_dps"]),
        "rate_raw_rmse_dps": rms(words["rate_turnps_q28"] * RATE_DPS, truth["rate_dps"]),
        "velocity_rmse_mps": rms(run.inputs.setpoint * VELOCITY_MPS, truth["velocity_mps"]),
        "tilt_max_deg": float(np.max(np.abs(truth["tilt_deg"]))),
        "fallen_steps": float(np.count_nonzero(words["flags"] & FLAG_FALLEN)),
        **(
            measures.Consistency.of(tilt, truth["tilt_deg"], scored, words["p00"], lsb_of(run.params)).to_metrics()
            if known
            else {}
        ),
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Tilt, its error, rate, bias, velocity, duty, and fixed point against float64."""
    time_s, words, truth = run.inputs.time_s, run.board_words, run.inputs.truth
    apart = measures.wrap_deg(run.words["tilt_turn_q32"] * TURN_DEG - run.reference["tilt_deg"])
    band = measures.with_offset(measures.two_sigma(words["p00"], lsb_of(run.params)), OFFSET_G)
    tilt = [
        Line("accelerometer only", accel_only_deg(run), SENSOR, 0.7),
        Line("true", truth["tilt_deg"], TRUTH, 1.6),
        Line("estimate ± 2 sigma", estimate_deg(run), ESTIMATE, band=band),
    ]
    if closed:
        tilt.insert(1, Line("lean asked for", words["lean_turn_q32"] * TURN_DEG, SECOND))
    error = measures.wrap_deg(estimate_deg(run) - truth["tilt_deg"])
    return [
        Plot("Tilt", "deg", time_s, tilt, of_band(OFFSET_G)),
        error_and_band(time_s, error, band, OFFSET_G),
        Plot(
            "Rate",
            "deg/s",
            time_s,
            [
                Line("gyro", words["rate_turnps_q28"] * RATE_DPS, SENSOR, 0.7),
                Line("true", truth["rate_dps"], TRUTH, 1.6),
                Line("corrected", words["rate_corrected_turnps_q28"] * RATE_DPS, ESTIMATE),
            ],
        ),
        Plot(
            "Gyro bias",
            "deg/s",
            time_s,
            [
                Line("true", truth["bias_dps"], TRUTH),
                Line("estimated", words["bias_turnps_q28"] * RATE_DPS, ESTIMATE),
            ],
        ),
        Plot(
            "Velocity",
            "m/s",
            time_s,
            [
                Line("asked for", run.inputs.setpoint * VELOCITY_MPS, SECOND),
                Line("true", truth["velocity_mps"], TRUTH, 1.6),
                Line("from the Hall sensors, filtered", words["velocity_mps_q26"] * VELOCITY_MPS, ESTIMATE),
            ],
        ),
        Plot("Duty of the bridge", "1 = full", time_s, [Line("duty", words["duty_q15"] * DUTY, ESTIMATE)]),
        error_budget(time_s, apart),
    ]

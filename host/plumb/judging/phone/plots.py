"""Metrics and plots of a run of `phone`.

The error of pitch and roll together is the angle between the estimated and the true vertical. It is defined at every
attitude, unlike the error of roll alone. `angle_...` means that angle.
"""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.proof import metrics as measures
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, error_budget, of_band
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.systems.phone.scenarios import G_MPS2, OFFSET_MPS2, inclination_deg, up
from plumb.tuning.variances import lsb_of

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

TURN_DEG = 360.0 / 2.0**32
"""Degrees per unit of a binary angle."""
RATE_DPS = 360.0 / 2.0**28
"""Degrees per second in a unit of a rate word."""
AXES = ("pitch", "roll")


def estimate_deg(run: Run, axis: str) -> FloatArray:
    """The board's pitch or roll, (steps,)."""
    return np.asarray(run.board_words[f"{axis}_turn_q32"] * TURN_DEG)


def error_deg(run: Run) -> FloatArray:
    """Angle between the estimated and the true vertical, (steps,)."""
    truth = up(*(run.inputs.truth[f"{axis}_deg"] for axis in AXES))
    return inclination_deg(up(*(estimate_deg(run, axis) for axis in AXES)), truth)


def accel_error_deg(run: Run) -> FloatArray:
    """The error of the accelerometer alone."""
    force = np.stack([run.words[f"accel_{axis}_g_q26"].astype(np.float64) for axis in "xyz"])
    return inclination_deg(force, up(*(run.inputs.truth[f"{axis}_deg"] for axis in AXES)))


def apart_deg(run: Run) -> FloatArray:
    """Angle between the verticals of integers and float64 on the same counts."""
    fixed = up(*(run.words[f"{axis}_turn_q32"] * TURN_DEG for axis in AXES))
    return inclination_deg(fixed, up(*(run.reference[f"{axis}_deg"] for axis in AXES)))


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of the vertical, then of the angles; None for a run without scored samples."""
    scored = run.inputs.scored

    def rms(error: FloatArray) -> float | None:
        return float(np.sqrt(np.mean(error[scored] ** 2))) if scored.any() else None

    error = error_deg(run)
    figures = {
        "angle_rmse_deg": rms(error),
        "angle_max_deg": float(np.max(error[scored])) if scored.any() else None,
        "accel_only_rmse_deg": rms(accel_error_deg(run)),
        "fixed_vs_reference_max_deg": float(np.max(apart_deg(run))),
    }
    for axis in AXES:
        truth = run.inputs.truth[f"{axis}_deg"]
        figures[f"{axis}_rmse_deg"] = rms(measures.wrap_deg(estimate_deg(run, axis) - truth))
    return figures


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Pitch and roll, the error of the vertical, biases, fixed point against float64."""
    time_s, known = run.inputs.time_s, bool(np.isfinite(run.inputs.truth["pitch_deg"]).any())
    found = []
    for axis in AXES:
        lines = [Line("accelerometer only", run.words[f"{axis}_measured_turn_q32"] * TURN_DEG, SENSOR, 0.7)]
        lines += [Line("true", run.inputs.truth[f"{axis}_deg"], TRUTH, 1.6)] if known else []
        band = measures.two_sigma(run.board_words[f"{axis}_p00"], lsb_of(run.params))
        band = measures.with_offset(band, OFFSET_MPS2 / G_MPS2)
        lines.append(Line("estimate ± 2 sigma", estimate_deg(run, axis), ESTIMATE, band=band))
        found.append(Plot(axis.capitalize(), "deg", time_s, lines, of_band(OFFSET_MPS2 / G_MPS2)))
    if known:
        lines = [
            Line("accelerometer only", accel_error_deg(run), SENSOR, 0.7),
            Line("estimate", error_deg(run), SECOND),
        ]
        note = (
            "The angle between the estimated and the true vertical. No band: the filters have variances of pitch and "
            "roll, not of the vertical."
        )
        found.append(Plot("Error of the vertical", "deg", time_s, lines, note))
    biases = [(axis, run.words[f"{axis}_bias_turnps_q28"] * RATE_DPS) for axis in AXES]
    found.append(
        Plot(
            "Gyro bias",
            "deg/s",
            time_s,
            [Line(axis, values, colour) for (axis, values), colour in zip(biases, (ESTIMATE, SECOND), strict=True)],
            "Of the rates that drive the filters: with Euler rates it turns with the phone.",
        )
    )
    found.append(error_budget(time_s, apart_deg(run)))
    return found

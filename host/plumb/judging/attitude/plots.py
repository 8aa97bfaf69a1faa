"""Metrics and plots of a run of `attitude`.

`angle_...` is the angle between the estimated and the true vertical, in body axes: an error of heading, which no
accelerometer can measure, does not count.
"""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, error_budget
from plumb.proof.runs import Run
from plumb.spec import declarations
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import Words
from plumb.systems.attitude.scenarios import apart_deg

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

BIAS_DPS = 360.0 / 2.0**32
"""Degrees per second in a unit of the bias."""
AXES = ("x", "y", "z")
COLOURS = (ESTIMATE, SECOND, TRUTH)
BAND = (
    "The angle between the estimated and the true vertical; of a recording, where it has a reference. Two sigma is"
    " twice the root of the sum of both variances of the tilt, as the filter states them: where its model of the"
    " sensors and of the motion holds, 98 % of the errors are below. It is not drawn while the tilt is flagged unsure."
)


def vertical(words: Words) -> FloatArray:
    """The estimated vertical in body axes, (3, steps)."""
    return np.stack([words[f"up_q30_{i}"] for i in range(3)]) / 2.0**30


def true_vertical(run: Run) -> FloatArray:
    """(3, steps); NaN where it is not known."""
    return np.stack([run.inputs.truth[f"up_{axis}"] for axis in AXES])


def error_deg(run: Run) -> FloatArray:
    """Angle between the estimated and the true vertical, (steps,)."""
    return apart_deg(vertical(run.board_words), true_vertical(run))


def accel_error_deg(run: Run) -> FloatArray:
    """The error of the accelerometer alone."""
    force = np.stack([run.words[f"accel_g_q25_{i}"] for i in range(3)]).astype(np.float64)
    return apart_deg(force, true_vertical(run))


def arithmetic_deg(run: Run) -> FloatArray:
    """Angle between the verticals of integers and float64 on the same counts."""
    return apart_deg(vertical(run.words), np.stack([run.reference[f"up_{axis}"] for axis in AXES]))


def two_sigma_deg(run: Run) -> FloatArray:
    """Twice the standard deviation of the tilt, both components together."""
    variance = run.board_words["tilt_variance_rad2_q32"].astype(np.float64) / 2.0**32
    return np.asarray(np.degrees(2.0 * np.sqrt(variance)))


def unsure(run: Run) -> BoolArray:
    """The steps with that flag, (steps,)."""
    flags = [flag.name for flag in declarations.system(run.system).flags]
    return np.asarray(run.board_words["flags"] >> flags.index("UNSURE") & 1, bool)


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of the vertical; None for a run without scored samples."""
    scored = run.inputs.scored

    def rms(error: FloatArray) -> float | None:
        return float(np.sqrt(np.mean(error[scored] ** 2))) if scored.any() else None

    error = error_deg(run)
    apart = arithmetic_deg(run)
    return {
        "angle_rmse_deg": rms(error),
        "angle_max_deg": float(np.max(error[scored])) if scored.any() else None,
        "accel_only_rmse_deg": rms(accel_error_deg(run)),
        "fixed_vs_reference_max_deg": float(np.max(apart)),
        "fixed_vs_reference_rms_deg": float(np.sqrt(np.mean(apart**2))),
        "within_two_sigma": float(np.mean((error <= two_sigma_deg(run))[scored])) if scored.any() else None,
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """The vertical, its error with two sigma, bias and scale error of the gyro, fixed point against float64."""
    time_s, known = run.inputs.time_s, bool(np.isfinite(run.inputs.truth["up_x"]).any())
    found, estimated, truth = [], vertical(run.board_words), true_vertical(run)
    lines = []
    for i, axis in enumerate(AXES):
        lines += [Line(f"{axis}, true", truth[i], SENSOR, 1.6)] if known else []
        lines.append(Line(axis, estimated[i], COLOURS[i]))
    found.append(Plot("Vertical in body axes", "1", time_s, lines))
    if known:
        lines = [
            Line("two sigma", np.where(unsure(run), np.nan, two_sigma_deg(run)), SECOND, 0.9),
            Line("estimate", error_deg(run), ESTIMATE),
        ]
        found.append(Plot("Error of the vertical", "deg", time_s, lines, BAND))
        alone = [Line("accelerometer only", accel_error_deg(run), SENSOR, 0.7), *lines[1:]]
        found.append(Plot("Error of the vertical, and of the accelerometer alone", "deg", time_s, alone))
    lines = []
    for i, axis in enumerate(AXES):
        true_dps = run.inputs.truth[f"bias_{axis}_dps"]
        lines += [Line(f"{axis}, true", true_dps, SENSOR, 1.6)] if np.isfinite(true_dps).any() else []
        lines.append(Line(axis, run.board_words[f"bias_turnps_q32_{i}"] * BIAS_DPS, COLOURS[i]))
    found.append(Plot("Bias of the gyro", "deg/s", time_s, lines))
    scales = [run.board_words[f"scale_q32_{i}"] * (100.0 / 2.0**32) for i in range(3)]
    lines = [Line(axis, scales[i], COLOURS[i]) for i, axis in enumerate(AXES)]
    found.append(Plot("Scale error of the gyro", "%", time_s, lines))
    found.append(error_budget(time_s, arithmetic_deg(run)))
    return found

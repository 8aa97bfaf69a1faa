"""Metrics and plots of a run of `quadrotor`.

`angle_...` is the angle between the estimated and the true vertical, in body axes; `flown_rmse_deg` that between the
true vertical and the one that the sticks ask for.
"""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.physics.pilots import vertical
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, error_budget
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.scenarios import apart_deg

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

AXES = ("x", "y", "z")
ROTORS = ("front right", "front left", "rear left", "rear right")
COLOURS = (ESTIMATE, SECOND, TRUTH, SENSOR)
RATE_DPS = 360.0 / 2.0**28
COMMAND = 2.0**-24
BAND = (
    "Two sigma is twice the root of the sum of both variances of the tilt, as the filter states them; before the first"
    " blocks it knows nothing."
)


def estimated(run: Run) -> FloatArray:
    """The estimated vertical in body axes, (3, steps)."""
    return np.stack([run.board_words[f"up_q30_{i}"] for i in range(3)]) / 2.0**30


def true_vertical(run: Run) -> FloatArray:
    """(3, steps)."""
    return np.stack([run.inputs.truth[f"up_{axis}"] for axis in AXES])


def error_deg(run: Run) -> FloatArray:
    """Angle between the estimated and the true vertical, (steps,)."""
    return apart_deg(estimated(run), true_vertical(run))


def arithmetic_deg(run: Run) -> FloatArray:
    """Angle between the verticals of integers and float64 on the same counts."""
    integers = np.stack([run.words[f"up_q30_{i}"] for i in range(3)]) / 2.0**30
    return apart_deg(integers, np.stack([run.reference[f"up_{axis}"] for axis in AXES]))


def accel_error_deg(run: Run) -> FloatArray:
    """The error of the accelerometer alone."""
    force = run.inputs.raw[:, 3:6].T.astype(np.float64)
    return apart_deg(force, true_vertical(run))


def flown_deg(run: Run) -> FloatArray:
    """Angle between the true vertical and the one that the pilot asks for."""
    truth = run.inputs.truth
    wanted = vertical(np.radians(truth["asked_roll_deg"]), np.radians(truth["asked_pitch_deg"]))
    return apart_deg(wanted, true_vertical(run))


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of the vertical, how well the vehicle flies, and the height that it keeps; None without scored samples."""
    scored, truth = run.inputs.scored, run.inputs.truth
    some = bool(scored.any())

    def rms(error: FloatArray) -> float | None:
        return float(np.sqrt(np.mean(error[scored] ** 2))) if some else None

    error = error_deg(run)
    height = truth["height_m"]
    return {
        "angle_rmse_deg": rms(error),
        "angle_max_deg": float(np.max(error[scored])) if some else None,
        "accel_only_rmse_deg": rms(accel_error_deg(run)),
        "fixed_vs_reference_max_deg": float(np.max(arithmetic_deg(run))),
        "flown_rmse_deg": rms(flown_deg(run)),
        "lean_max_deg": float(np.max(truth["lean_deg"])),
        "height_least_m": float(np.min(height[scored])) if some else None,
        "height_most_m": float(np.max(height[scored])) if some else None,
    }


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Lean, its error, rates, rotors, height, and fixed point against float64."""
    time_s, words, truth = run.inputs.time_s, run.board_words, run.inputs.truth
    up = estimated(run)
    two_sigma = np.degrees(2.0 * np.sqrt(words["tilt_variance_rad2_q32"].astype(np.float64) / 2.0**32))
    two_sigma = np.where(words["flags"] >> 3 & 1, np.nan, two_sigma)
    asked = vertical(np.radians(truth["asked_roll_deg"]), np.radians(truth["asked_pitch_deg"]))
    plots = [
        Plot("Lean", "deg", time_s, [
            Line("asked for", np.degrees(np.arccos(np.clip(asked[2], -1.0, 1.0))), SECOND),
            Line("true", truth["lean_deg"], TRUTH, 1.6),
            Line("estimate", np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))), ESTIMATE),
        ]),
        Plot("Error of the vertical", "deg", time_s, [
            Line("two sigma", two_sigma, SECOND, 0.9), Line("estimate", error_deg(run), ESTIMATE),
        ], BAND),
    ]  # fmt: skip
    for i, axis in enumerate(AXES):
        lines = [
            Line("asked for", words[f"asked_turnps_q28_{i}"] * RATE_DPS, SECOND),
            Line("true", truth[f"rate_{axis}_dps"], TRUTH, 1.6),
            Line("estimate", words[f"rate_turnps_q28_{i}"] * RATE_DPS, ESTIMATE),
        ]
        plots.append(Plot(f"Rate about {axis}", "deg/s", time_s, lines))
    rotors = [Line(name, words[f"rotor_q24_{i}"] * COMMAND, COLOURS[i], 0.8) for i, name in enumerate(ROTORS)]
    plots.append(Plot("Commands of the rotors", "1 = full", time_s, rotors))
    if closed:
        plots.append(Plot("Height", "m", time_s, [Line("true", truth["height_m"], TRUTH)]))
    plots.append(error_budget(time_s, arithmetic_deg(run)))
    return plots

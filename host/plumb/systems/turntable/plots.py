"""What a run of `turntable` is measured by, and what it looks like.

A residual is the rotation vector from the true to the estimated attitude, in the body's axes; `angle_...` means its
length. There is no accelerometer: accel_only_rmse_deg is None.
"""

from __future__ import annotations

import numpy as np

from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, error_budget
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.turntable.gyro import attitudes, interpolated
from plumb.systems.turntable.motion import REST_S
from plumb.systems.turntable.reference import rotation_deg

RATE_DPS = 360.0 / 2.0**28
"""Degrees per second in a unit of a rate word."""
FLAG_GYRO, FLAG_SPIKE = 4, 16
AXES = "xyz"
COLOURS = (ESTIMATE, SECOND, SENSOR)


def attitude(words: Words) -> FloatArray:
    """The estimated attitude, (steps, 4)."""
    return np.stack([words[f"attitude_{axis}_q30"] / 2.0**30 for axis in "wxyz"], axis=-1)


def reference_attitude(values: dict[str, FloatArray]) -> FloatArray:
    """The same of float64, or of the truth, (steps, 4)."""
    return np.stack([values[f"attitude_{axis}"] for axis in "wxyz"], axis=-1)


def residuals_deg(run: Run) -> FloatArray:
    """(steps, 3)."""
    return rotation_deg(reference_attitude(run.inputs.truth), attitude(run.board_words))


def apart_deg(run: Run) -> FloatArray:
    """Angle between the integers' and float64's attitude on the same counts, (steps,)."""
    both = rotation_deg(reference_attitude(run.reference), attitude(run.words))
    return np.asarray(np.linalg.norm(both, axis=1), np.float64)


def gyro_residuals_deg(run: Run) -> FloatArray | None:
    """Of the gyro alone over the motion, (samples, 3): calibrated, its spikes replaced by the prefilter. None where it
    has no samples to begin with."""
    words, time_s = run.words, run.inputs.time_s
    at = np.flatnonzero(words["flags"] & FLAG_GYRO)
    if len(at) < 2 or not (time_s[at] < REST_S).any():
        return None
    age_step = words["gyro_age_step_q24"][at] / 2.0**24
    rate = np.stack([words[f"rate_turnps_q28_{i}"][at] * RATE_DPS for i in range(3)], axis=-1)
    sampled_s = time_s[at] - age_step * run.params.period_s
    truth = reference_attitude(run.inputs.truth)
    share = np.zeros(len(time_s))
    share[at] = age_step
    there, moving = interpolated(truth, share)[at], sampled_s >= REST_S
    return rotation_deg(there[moving], attitudes(sampled_s, rate)[moving])


def metrics(run: Run) -> dict[str, float | None]:
    """Errors of the attitude, then per axis as the patent reports them; the gyro alone beside them. None where nothing
    is to be scored."""
    scored = run.inputs.scored
    found: dict[str, float | None] = dict.fromkeys(("angle_rmse_deg", "angle_max_deg", "accel_only_rmse_deg"))
    found["fixed_vs_reference_max_deg"] = float(np.max(apart_deg(run)))
    if not scored.any():
        return found
    residual = np.abs(residuals_deg(run)[scored])
    length = np.linalg.norm(residual, axis=1)
    found["angle_rmse_deg"] = float(np.sqrt(np.mean(length**2)))
    found["angle_max_deg"] = float(np.max(length))
    for name, of, values in (("mean", np.mean, residual), ("max", np.max, residual)):
        found |= {f"residual_{name}_{axis}_deg": float(of(values[:, i])) for i, axis in enumerate(AXES)}
    gyro = gyro_residuals_deg(run)
    if gyro is not None and len(gyro):
        alone = np.abs(gyro)
        found["gyro_only_mean_deg"] = float(np.mean(alone))
        found["gyro_only_max_deg"] = float(np.mean(np.max(alone, axis=0)))
        found["below_gyro_mean_percent"] = 100.0 * (1.0 - float(np.mean(residual)) / float(np.mean(alone)))
        both = float(np.mean(np.max(residual, axis=0))) / float(np.mean(np.max(alone, axis=0)))
        found["below_gyro_max_percent"] = 100.0 * (1.0 - both)
    return found


def plots(run: Run, *, closed: bool) -> list[Plot]:
    """Rates, residuals, biases, what was learnt of scale and lag, fixed point against float64."""
    time_s, words, truth = run.inputs.time_s, run.words, run.inputs.truth
    residual = residuals_deg(run)

    def lines(word: str, unit: float) -> list[Line]:
        return [Line(AXES[i], words[f"{word}_{i}"] * unit, COLOURS[i]) for i in range(3)]

    period_s = run.params.period_s
    error = [
        Line(AXES[i], words[f"rate_corrected_turnps_q28_{i}"] * RATE_DPS - truth[f"rate_dps_{i}"], COLOURS[i], 0.7)
        for i in range(3)
    ]
    return [
        Plot("True rate", "deg/s", time_s, [Line(AXES[i], truth[f"rate_dps_{i}"], COLOURS[i]) for i in range(3)]),
        Plot("Residual of the attitude", "deg", time_s, [Line(AXES[i], residual[:, i], COLOURS[i]) for i in range(3)]),
        Plot("Error of the corrected rate", "deg/s", time_s, error),
        Plot("Gyro bias", "deg/s", time_s, lines("bias_gyro_turnps_q34", 360.0 / 2.0**34)),
        Plot(
            "Bias of the angular accelerometer",
            "deg/s^2",
            time_s,
            lines("bias_angular_turnps_q42", 360.0 / 2.0**42 / period_s),
        ),
        Plot("Difference in scale", "%", time_s, lines("scale_q30", 100.0 / 2.0**30)),
        Plot("Lag of the gyro", "ms", time_s, lines("lag_step_q24", 1e3 * period_s / 2.0**24)),
        error_budget(time_s, apart_deg(run)),
    ]

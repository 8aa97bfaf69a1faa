"""Metrics and plots of a run of `turntable`.

A residual is the rotation vector from the true to the estimated attitude, in the body's axes; `angle_...` means its
length. There is no accelerometer: accel_only_rmse_deg is None.
"""

from __future__ import annotations

import numpy as np

from plumb.judging import angles
from plumb.judging.turntable.gyro import attitudes, interpolated
from plumb.proof.metrics import two_sigma
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, TWO_SIGMA, Line, Plot, error_budget
from plumb.proof.runs import Run
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.turntable.motion import REST_S
from plumb.systems.turntable.reference import rotation_deg

MEASURES, MAIN, APART = angles.MEASURES, angles.MAIN, angles.APART

RATE_DPS = 360.0 / 2.0**28
"""Degrees per second in a unit of a rate word."""
FLAG_GYRO, FLAG_SPIKE = 4, 16
AXES = "xyz"
COLOURS = (ESTIMATE, SECOND, SENSOR)
ATTITUDE_LAYER = 1
"""Value of the parameter fusion.layer: with it alone the published rate is not a state of the filter."""


def attitude(words: Words) -> FloatArray:
    """The estimated attitude, (steps, 4)."""
    return np.stack([words[f"attitude_{axis}_q30"] / 2.0**30 for axis in "wxyz"], axis=-1)


def reference_attitude(values: dict[str, FloatArray]) -> FloatArray:
    """The attitude of the reference model, or the true one, (steps, 4)."""
    return np.stack([values[f"attitude_{axis}"] for axis in "wxyz"], axis=-1)


def residuals_deg(run: Run) -> FloatArray:
    """Residuals in deg, (steps, 3)."""
    return rotation_deg(reference_attitude(run.inputs.truth), attitude(run.board_words))


def apart_deg(run: Run) -> FloatArray:
    """Angle in deg between the attitudes of integers and float64 on the same counts, (steps,)."""
    both = rotation_deg(reference_attitude(run.reference), attitude(run.words))
    return np.asarray(np.linalg.norm(both, axis=1), np.float64)


def gyro_residuals_deg(run: Run) -> FloatArray | None:
    """Residuals in deg of the gyro alone over the motion, (samples, 3), with spikes replaced by the prefilter. None if
    the gyro has no samples at the beginning."""
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
    """Errors of the attitude, per axis as the patent reports them, and of the gyro alone; None for a run without scored
    samples."""
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
    """Rates, residuals, biases, estimates of scale and lag, and fixed point against float64. The record has variances
    of the rate, the biases, scale and lag, but none of the attitude."""
    time_s, words, truth, period_s = run.inputs.time_s, run.words, run.inputs.truth, run.params.period_s
    residual = residuals_deg(run)

    def lines(word: str, unit: float, bands: list[FloatArray]) -> list[Line]:
        return [Line(AXES[i], words[f"{word}_{i}"] * unit, COLOURS[i], band=bands[i]) for i in range(3)]

    def of_axes(word: str, unit: float) -> list[FloatArray]:
        """Twice the standard deviation of a parameter that each axis learns."""
        return [two_sigma(words[f"{word}_variance_q60_{i}"], unit**2 / 2.0**60) for i in range(3)]

    rate_dps, gyro_bias_dps, angular_bias_dps2 = (
        two_sigma(words[name], unit**2 / 2.0**64)
        for name, unit in (("p00_q64", 360.0), ("p11_q64", 360.0), ("p22_q64", 360.0 / (4.0 * period_s)))
    )
    error = [
        Line(AXES[i], words[f"rate_corrected_turnps_q28_{i}"] * RATE_DPS - truth[f"rate_dps_{i}"], COLOURS[i], 0.7)
        for i in range(3)
    ]
    of_state = run.params["fusion.layer"] != ATTITUDE_LAYER
    if of_state:
        error.insert(0, Line("expected: 0 ± 2 sigma", np.zeros(len(time_s)), TRUTH, 0.8, rate_dps))
    error_note = (
        f"{TWO_SIGMA} The variance has no part for the scale errors of the two sensors."
        if of_state
        else "No band: in the attitude layer the published rate is the gyro's own, of which the filter has no variance."
    )
    return [
        Plot("True rate", "deg/s", time_s, [Line(AXES[i], truth[f"rate_dps_{i}"], COLOURS[i]) for i in range(3)]),
        Plot(
            "Residual of the attitude",
            "deg",
            time_s,
            [Line(AXES[i], residual[:, i], COLOURS[i]) for i in range(3)],
            "The rotation from the true to the estimated attitude, in the body's axes. No band: the filter has no "
            "variance of the attitude.",
        ),
        Plot("Error of the corrected rate", "deg/s", time_s, error, error_note),
        Plot(
            "Gyro bias ± 2 sigma",
            "deg/s",
            time_s,
            lines("bias_gyro_turnps_q34", 360.0 / 2.0**34, [gyro_bias_dps] * 3),
        ),
        Plot(
            "Bias of the angular accelerometer ± 2 sigma",
            "deg/s^2",
            time_s,
            lines("bias_angular_turnps_q42", 360.0 / 2.0**42 / period_s, [angular_bias_dps2] * 3),
        ),
        Plot(
            "Difference in scale ± 2 sigma",
            "%",
            time_s,
            lines("scale_q30", 100.0 / 2.0**30, of_axes("scale", 100.0)),
            "Scale of the gyro less that of the angular accelerometer.",
        ),
        Plot(
            "Lag of the gyro ± 2 sigma",
            "ms",
            time_s,
            lines("lag_step_q24", 1e3 * period_s / 2.0**24, of_axes("lag", 1e3 * period_s)),
        ),
        error_budget(time_s, apart_deg(run)),
    ]

"""Metrics of a run. Angles are in degrees, times in seconds; each metric states its window.

Estimator metrics use t >= 10 s, in runs under 20 s the second half: the first 3 s are at rest and may give the starting
bias, and `convergence` measures the start-up of the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import BoolArray, FloatArray

BIAS_CONVERGED_DPS = 1.0
HOLD_WITHIN_DEG, HOLD_SETTLE_S, HOLD_DWELL_S = 2.0, 2.0, 1.0


def wrap_deg(angle_deg: npt.ArrayLike) -> FloatArray:
    """The same angles in -180 <= angle < 180, any shape."""
    angle = np.asarray(angle_deg, np.float64)
    return np.asarray(angle - 360.0 * np.floor((angle + 180.0) / 360.0))


def two_sigma(variance_lsb: npt.ArrayLike, lsb: float) -> FloatArray:
    """Twice the standard deviation that the filter itself states, any shape. variance_lsb: its variance after the step;
    lsb: one lsb of it in the square of the result's unit; for an angle's p00 `plumb.tuning.variances.lsb_of`."""
    return np.asarray(2.0 * np.sqrt(np.maximum(np.asarray(variance_lsb, np.float64), 0.0) * lsb))


def with_offset(two_sigma_deg: FloatArray, offset_g: float) -> FloatArray:
    """A band of a tilt, widened by the accelerometer's offset, which no filter sees. offset_g: its standard deviation
    over devices, in g; near level g is the tilt in rad."""
    return np.asarray(np.hypot(two_sigma_deg, 2.0 * np.degrees(offset_g)), np.float64)


def angle_rmse_deg(estimate_deg: FloatArray, truth_deg: FloatArray, window: BoolArray) -> FloatArray:
    """Root mean square of the wrapped error over the window, (steps[, runs]) -> () or (runs,)."""
    return rms(wrap_deg(estimate_deg[window] - truth_deg[window]))


def rms(error: FloatArray) -> FloatArray:
    """Root mean square over the steps, (steps[, runs]) -> () or (runs,)."""
    return np.asarray(np.sqrt(np.mean(error * error, axis=0)))


def angle_max_deg(estimate_deg: FloatArray, truth_deg: FloatArray, window: BoolArray) -> FloatArray:
    """Largest wrapped error over the window, (steps[, runs]) -> () or (runs,)."""
    return np.asarray(np.max(np.abs(wrap_deg(estimate_deg[window] - truth_deg[window])), axis=0))


@dataclass(frozen=True)
class Consistency:
    """mean: of the error over the window; spread: its standard deviation about the mean, deg. per_sigma: the spread
    as a share of the standard deviation that the filter states itself, rms over the window."""

    mean: float
    spread: float
    per_sigma: float

    @classmethod
    def of(
        cls, estimate_deg: FloatArray, truth_deg: FloatArray, window: BoolArray, variance_lsb: npt.ArrayLike, lsb: float
    ) -> Consistency:
        """variance_lsb: the filter's variance after each step; lsb: one of it in deg^2. All (steps,)."""
        return cls.of_errors(wrap_deg(estimate_deg[window] - truth_deg[window]), np.asarray(variance_lsb)[window], lsb)

    @classmethod
    def of_errors(cls, error_deg: FloatArray, variance_lsb: npt.NDArray[np.int64], lsb: float) -> Consistency:
        """The same of the wrapped errors and the variances of a window, (samples,) each."""
        variance = float(np.mean(variance_lsb, dtype=np.float64)) * lsb
        spread = float(np.std(error_deg))
        return cls(float(np.mean(error_deg)), spread, spread / variance**0.5 if variance > 0.0 else float("nan"))

    def to_metrics(self) -> dict[str, float | None]:
        return {"angle_mean_deg": self.mean, "angle_spread_deg": self.spread, "spread_per_sigma": self.per_sigma}


def accel_only_deg(accel_y_g: FloatArray, accel_z_g: FloatArray) -> FloatArray:
    """Tilt by the accelerometer alone: atan2(ay, az) of the sampled values, any shape."""
    return np.asarray(np.degrees(np.arctan2(accel_y_g, accel_z_g)))


def accel_only_rmse_deg(
    accel_y_g: FloatArray, accel_z_g: FloatArray, truth_deg: FloatArray, window: BoolArray
) -> FloatArray:
    """Root mean square error of the accelerometer alone: every filter must be better."""
    return angle_rmse_deg(accel_only_deg(accel_y_g, accel_z_g), truth_deg, window)


def gyro_only_deg(rate_dps: FloatArray, period_s: float, start_deg: FloatArray, rest_s: float = 3.0) -> FloatArray:
    """Tilt by the gyro alone, (steps[, runs]): the rate minus its mean over the first rest_s, summed from start_deg."""
    rest = max(1, round(rest_s / period_s))
    rate_dps = rate_dps - np.mean(rate_dps[:rest], axis=0)
    travelled_deg = np.concatenate([np.zeros_like(rate_dps[:1]), np.cumsum(rate_dps[:-1] * period_s, axis=0)])
    return np.asarray(start_deg + travelled_deg)


@dataclass(frozen=True)
class Convergence:
    """time_s: from the start until |bias error| stays below 1 deg/s, infinite if never; angle_max_deg from then on."""

    time_s: float
    angle_max_deg: float


def convergence(bias_error_dps: FloatArray, tilt_error_deg: FloatArray, period_s: float) -> Convergence:
    """Convergence of one run, arrays (steps,); step k ends k + 1 periods after the start."""
    first = _settled(bias_error_dps)
    if first == len(bias_error_dps):
        return Convergence(float("inf"), float("inf"))
    return Convergence((first + 1) * period_s, float(np.max(np.abs(wrap_deg(tilt_error_deg[first:])))))


def settled_s(bias_error_dps: FloatArray, period_s: float) -> float:
    """`Convergence.time_s` alone."""
    first = _settled(bias_error_dps)
    return float("inf") if first == len(bias_error_dps) else (first + 1) * period_s


def _settled(bias_error_dps: FloatArray) -> int:
    """The first step from which the bias stays near the true one; the number of steps if it never does."""
    outside = np.flatnonzero(np.abs(bias_error_dps) >= BIAS_CONVERGED_DPS)
    return int(outside[-1]) + 1 if len(outside) else 0


@dataclass(frozen=True)
class Hold:
    """recovery_s: from the release until |tilt - setpoint| <= 2 deg, and for 1 s on; rms and maximum: from 2 s after
    the release.

    A later excursion does not make the recovery fail: it counts in rms and maximum.
    """

    recovery_s: float
    rms_deg: float
    max_deg: float


def hold(time_s: FloatArray, true_tilt_deg: FloatArray, setpoint_deg: FloatArray, release_s: float) -> Hold:
    """Attitude hold of one closed-loop run by its true tilt, arrays (steps,)."""
    error_deg = np.abs(wrap_deg(true_tilt_deg - setpoint_deg))
    late = error_deg[time_s >= release_s + HOLD_SETTLE_S]
    if not len(late):
        return Hold(float("inf"), float("nan"), float("nan"))
    dwell = max(1, round(HOLD_DWELL_S / float(time_s[1] - time_s[0])))
    outside = np.cumsum(error_deg > HOLD_WITHIN_DEG)
    stays = np.flatnonzero((time_s[:-dwell] >= release_s) & (outside[dwell:] == outside[:-dwell]))
    # The sample after the last one outside the band; the release itself when there is none.
    first = int(stays[0]) + (error_deg[stays[0]] > HOLD_WITHIN_DEG) if len(stays) else None
    recovery_s = float("inf") if first is None else float(time_s[first] - release_s)
    return Hold(recovery_s, float(np.sqrt(np.mean(late * late))), float(np.max(late)))

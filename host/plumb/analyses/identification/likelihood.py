"""Q and R that make the innovations of a recording most likely, with their confidence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plumb.analyses.identification.innovations import Innovations, Measured, Variances, innovations
from plumb.analyses.identification.noise_fit import DROP, Estimate
from plumb.spec.arrays import FloatArray

NAMES = ("q_angle_deg2_per_s", "q_bias_dps2_per_s", "r_deg2")
LOW, HIGH = (1e-9, 1e-12, 1e-6), (1e4, 1e2, 1e5)
"""Ends of the search; the firmware's integers hold less."""
PROBE = 0.1
"""Step of the logarithms at which the curvature of the likelihood is measured."""
TOLERANCE = 0.02
"""Changes of the logarithms and of the logarithm of the likelihood at which the search ends."""
QUICK_BIAS = 0.1
"""Q of a bias that walks fast, of Q of the angle: the second place to start the search from."""
FLAT = 1e-6
"""Curvature below which the likelihood does not determine a setting."""
STEPS_MAX = 400


@dataclass(frozen=True)
class FilterFit:
    """The recording with the variances before and after. figures: by name, the value and its 95 % interval after; kept:
    names of settings that the recording does not determine, which stay as they were."""

    before: Innovations
    after: Innovations
    variances: Variances
    figures: dict[str, Estimate]
    kept: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Gain of the logarithm of the likelihood."""
        return self.before.loss - self.after.loss


def fit(measured: Measured, start: Variances, note: Callable[[], object] = lambda: None) -> FilterFit:
    """The most likely variances. start: those of the tuning; note: called after every run over the recording.

    A bias whose walk the recording does not show (the likelihood at the tuning's own Q of the bias is within its 95 %)
    keeps that Q: most likely would be none at all, and a filter with none stops following the bias.
    """

    def loss(logs: FloatArray) -> float:
        note()
        return innovations(measured, _variances(logs)).loss

    given = np.clip(np.log(_values(start)), np.log(LOW), np.log(HIGH))
    quick = given.copy()
    quick[1] = given[0] + math.log(QUICK_BIAS)
    found = [_search(loss, place, (0, 1, 2)) for place in (given, quick)]
    best, least = min(found, key=lambda one: one[1])
    free: tuple[int, ...] = (0, 1, 2)
    kept: tuple[str, ...] = ()
    held = best.copy()
    held[1] = given[1]
    restrained, most = _search(loss, held, (0, 2))
    if most - least <= DROP:
        best, least, free, kept = restrained, most, (0, 2), (NAMES[1],)
    best, spread = _refined(loss, best, least, free)
    figures = {NAMES[index]: _interval(float(best[index]), spread[at]) for at, index in enumerate(free)}
    variances = _variances(best)
    return FilterFit(innovations(measured, start), innovations(measured, variances), variances, figures, kept)


def _values(variances: Variances) -> FloatArray:
    return np.array([getattr(variances, name) for name in NAMES], np.float64)


def _variances(logs: FloatArray) -> Variances:
    return Variances(*(float(value) for value in np.exp(logs)))


def _search(loss: Callable[[FloatArray], float], start: FloatArray, free: tuple[int, ...]) -> tuple[FloatArray, float]:
    """Least loss over the logarithms of these places, by Nelder and Mead; the others stay."""
    from scipy.optimize import minimize

    places = list(free)

    def of_free(values: FloatArray) -> float:
        logs = start.copy()
        logs[places] = values
        return loss(logs)

    corner = start[places]
    simplex = np.vstack([corner, corner + np.eye(len(places))])
    limits = [(math.log(LOW[place]), math.log(HIGH[place])) for place in places]
    options = {"xatol": TOLERANCE, "fatol": TOLERANCE, "maxfev": STEPS_MAX, "initial_simplex": simplex}
    found = minimize(of_free, corner, method="Nelder-Mead", bounds=limits, options=options)
    logs = start.copy()
    logs[places] = found.x
    return logs, float(found.fun)


def _refined(
    loss: Callable[[FloatArray], float], best: FloatArray, least: float, free: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """The logarithms after a Newton step, and their standard deviations, from slope and curvature of the likelihood;
    infinite where it is flat."""
    count = len(free)
    units = np.eye(len(best))[list(free)] * PROBE
    up = np.array([loss(best + unit) for unit in units])
    down = np.array([loss(best - unit) for unit in units])
    curvature = np.diag((up + down - 2.0 * least) / PROBE**2)
    for i in range(count):
        for j in range(i):
            alike = loss(best + units[i] + units[j]) + loss(best - units[i] - units[j])
            sides = up[i] + down[i] + up[j] + down[j]
            curvature[i, j] = curvature[j, i] = (alike - sides + 2.0 * least) / (2.0 * PROBE**2)
    if np.min(np.linalg.eigvalsh(curvature)) <= FLAT:
        return best, np.full(count, math.inf)
    covariance = np.linalg.inv(curvature)
    step = np.zeros_like(best)
    step[list(free)] = -covariance @ ((up - down) / (2.0 * PROBE))
    then = np.clip(best + step, np.log(LOW), np.log(HIGH))
    return then if loss(then) < least else best, np.sqrt(np.diag(covariance))


def _interval(log_value: float, spread: float) -> Estimate:
    factor = math.exp(min(1.96 * float(spread), 700.0 - abs(log_value)))
    value = math.exp(log_value)
    return Estimate(value, value / factor, value * factor)

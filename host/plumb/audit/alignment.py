"""Axes, factor and lag of the gyro against the accelerometer: candidates by regression, judged by carrying.

A candidate is told from another when it is better over most windows (t of the difference); what is not told from the
axes as read is no finding. Vehicles that keep their acceleration along one axis, and recordings without turning, tell
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit import carried, factors, signed_axes
from plumb.audit.turning import LONGEST_LAG_S, Turning, turning_of
from plumb.spec.arrays import BoolArray, FloatArray

SEEN = 0.5
"""Share of the turning from which the regression gives the factor."""
TURNED = 0.8
"""Errors of the best candidate, of those without turning, so that there was something to explain."""
RATES_DPS = (1.0, 4000.0)
"""Rms in motion that a candidate for the factor may give."""
CLOSE = 1.15
"""Error of a candidate, of the best, up to which it counts as good as that."""
LEAST_DEG = 1e-3
"""Errors below, in g, are those of noise alone."""


@dataclass(frozen=True)
class Alignment:
    """told: whether anything can be said; axes: place in EVERY; factor; lag_s: positive for a late gyro; error,
    as_read_error, still_error: mean errors in g of the best candidate, of the axes as read with the same factor, and
    without turning; ties: places of all axes that are not told from the best; lag_t: what the lag gains; lags_s,
    lag_errors: over lags; turning: the regression."""

    told: bool
    axes: int = signed_axes.AS_READ
    factor: float = 1.0
    lag_s: float = 0.0
    error: float = float("nan")
    as_read_error: float = float("nan")
    still_error: float = float("nan")
    factor_as_read_error: float = float("nan")
    ties: tuple[int, ...] = ()
    lag_t: float = 0.0
    lags_s: FloatArray | None = None
    lag_errors: FloatArray | None = None
    turning: Turning | None = None


def alignment_of(u: FloatArray, gyr_dps: FloatArray, usable: BoolArray, step_s: float) -> Alignment:
    """On an even grid. u (n, 3): acceleration in units of its length at rest; gyr_dps (n, 3): as read; usable (n,)."""
    margin = round(LONGEST_LAG_S / step_s) + 1
    turning = turning_of(u, gyr_dps, usable, step_s)
    windows = carried.windows_of(u, gyr_dps, usable, step_s, margin)
    if turning is None or windows is None:
        return Alignment(False, turning=turning)
    seen = turning.explained >= SEEN
    lag = round(turning.lag_s / step_s) if seen else 0
    candidates = _factors(turning, seen, gyr_dps)
    errors = {factor: _of_axes(windows, factor, lag) for factor in candidates}
    still = carried.errors(windows, np.zeros((1, 3, 3)), np.zeros(1))[0]
    factor = _likeliest(errors)
    axes = _simplest(errors[factor])
    lags = np.unique(np.round(np.linspace(-margin + 1, margin - 1, 31)).astype(int))
    lags = np.unique(np.concatenate([lags, [0, lag]]))
    of_lags, lags = _refined(windows, factor * signed_axes.EVERY[axes], lags)
    best_lag = int(lags[of_lags.mean(1).argmin()])
    if best_lag != lag:
        errors[factor] = _of_axes(windows, factor, best_lag)
        axes = _simplest(errors[factor])
        of_lags, lags = _refined(windows, factor * signed_axes.EVERY[axes], lags)
    own = errors[factor]
    ties = tuple(place for place in range(48) if not _told(own[place], own[axes]))
    means = of_lags.mean(1)
    best, zero = int(means.argmin()), int(np.flatnonzero(lags == 0)[0])
    error = float(means[best])
    told = carried.t_of(still - of_lags[best]) >= carried.SURE_T and error < TURNED * float(still.mean())
    lag_t = 0.0 if best == zero else carried.t_of(of_lags[zero] - of_lags[best])
    return Alignment(
        told,
        axes,
        factor,
        _peak(lags * step_s, means, best),
        error,
        float(own[signed_axes.AS_READ].mean()),
        float(still.mean()),
        float(errors[1.0].mean(1).min()) if 1.0 in errors else float("nan"),
        ties,
        lag_t,
        lags * step_s,
        means,
        turning,
    )


def _factors(turning: Turning, seen: bool, gyr_dps: FloatArray) -> list[float]:
    """The regression's, where it sees; else all known ones that give rates of a moving body."""
    if seen:
        # Accelerations of the body make the regression's factor too small, but not by half.
        near = {one.value for one in factors.GYRO if 0.7 < one.value / turning.factor < 1.6}
        return sorted({turning.factor, 1.0} | near)
    moving = np.linalg.norm(gyr_dps - np.median(gyr_dps, axis=0), axis=1)
    rms = float(np.sqrt(np.mean(moving[moving >= np.median(moving)] ** 2)))
    low, high = RATES_DPS
    values = sorted({one.value for one in factors.GYRO if low <= one.value * rms <= high} | {1.0})
    # Of two that are alike the regression could not choose, and the carried mean cannot either.
    return [one for at, one in enumerate(values) if one == 1.0 or at == 0 or one > 1.15 * values[at - 1]]


def _likeliest(errors: dict[float, FloatArray]) -> float:
    """The factor with the least errors (48, windows) of its best axes; 1, or a known one, where that is not told."""
    best = {factor: of_axes[of_axes.mean(1).argmin()] for factor, of_axes in errors.items()}
    order = sorted(best, key=lambda one: float(best[one].mean()))
    known = [one for one in order if factors.nearest(one, factors.GYRO, 1e-6)]
    for simpler in ([1.0] if 1.0 in best else []) + known:
        if not _told(best[simpler], best[order[0]]):
            return simpler
    return order[0]


def _of_axes(windows: carried.Windows, factor: float, lag: int) -> FloatArray:
    return carried.errors(windows, factor * signed_axes.EVERY, np.full(48, lag))


def _refined(windows: carried.Windows, matrix: FloatArray, lags: np.ndarray) -> tuple[FloatArray, np.ndarray]:
    """Errors over lags, (lags, windows), with every step near the best of those given."""
    coarse = carried.errors(windows, np.repeat(matrix[None], len(lags), 0), lags)
    middle, most = int(lags[coarse.mean(1).argmin()]), int(lags[-1])
    step = int(np.max(np.diff(lags)))
    near = np.arange(max(-most, middle - step), min(most, middle + step) + 1)
    every = np.unique(np.concatenate([lags, near[:: max(1, step // 6)]]))
    return carried.errors(windows, np.repeat(matrix[None], len(every), 0), every), every


def _told(other: FloatArray, best: FloatArray) -> bool:
    """Whether the errors (windows,) of a candidate are told from those of the best."""
    clearly = float(other.mean()) > CLOSE * float(best.mean()) + LEAST_DEG
    return clearly and carried.t_of(other - best) >= carried.SURE_T


def _simplest(errors: FloatArray) -> int:
    """The best axes, or those as read where they are not told from them."""
    best = int(errors.mean(1).argmin())
    return best if _told(errors[signed_axes.AS_READ], errors[best]) else signed_axes.AS_READ


def _peak(lags_s: FloatArray, errors: FloatArray, at: int) -> float:
    """The lag of the least error, by the parabola through it and its neighbours."""
    if not 0 < at < len(errors) - 1:
        return float(lags_s[at])
    slope_in = (errors[at] - errors[at - 1]) / (lags_s[at] - lags_s[at - 1])
    slope_out = (errors[at + 1] - errors[at]) / (lags_s[at + 1] - lags_s[at])
    if slope_out <= slope_in:
        return float(lags_s[at])
    before, after = 0.5 * (lags_s[at] + lags_s[at - 1]), 0.5 * (lags_s[at + 1] + lags_s[at])
    return float(before - slope_in * (after - before) / (slope_out - slope_in))

"""Does the gyro explain how the accelerometer's direction turns? One regression over axes, factors and lags.

In sensor axes a direction u that is fixed to the earth turns by u' = u x w. With the gyro's reading g,
w = k P g(t + L): a factor k, one of the 48 signed permutations P, a lag L. Multiplied by a smooth window and integrated
by parts, the derivative falls on the window, and the equation stays linear in M = k P for turns of any size:

    -integral(window' u) = integral(window (u x M g))

Windows are B-splines of several lengths; the one that explains most is used. Their weights fall where the length of the
acceleration is not that of gravity. Rates about the vertical are not seen by this, and accelerations of the body hide
the turning: plumb/audit/carried.py then tells more, and needs the candidates that this finds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.audit import signed_axes
from plumb.spec.arrays import BoolArray, FloatArray

WINDOWS_S = (0.0, 0.04, 0.12, 0.4)
"""Lengths of a third of a window; at least one step of the grid."""
SCREEN_WINDOW_S, SCREEN_TIE = 0.12, 0.95
"""Of the one regression of a screen: its window, and the share of the best axes' share that counts as a tie."""
LAGS = (0, 2, 4, 7, 11, 16, 22, 30, 38)
"""Steps of the grid to either side, of at most LONGEST_LAG_S."""
LONGEST_LAG_S = 0.3
OFF_G = 0.15
"""Error of the length that lowers the weight of a window to a quarter."""
MOST_POINTS = 20_000
_CROSS = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_a, _b, _c], _CROSS[_a, _c, _b] = 1.0, -1.0


@dataclass(frozen=True)
class Turning:
    """explained: the share of the turning that the best P, k and lag explain, 1 at most; axes: place of that P in
    EVERY; factor: its k; lag_s: positive where the gyro is late; as_read: the share with the axes as read; turned,
    predicted (rows, 3): what the accelerometer turned, and what this gyro explains of it, 1/s."""

    explained: float
    axes: int
    factor: float
    lag_s: float
    as_read: float
    turned: FloatArray
    predicted: FloatArray


@dataclass(frozen=True)
class Screened:
    """explained: the share that the best P and k explain; factor: its k; right_axes: whether P is as read, or ties with
    it."""

    explained: float
    factor: float
    right_axes: bool


def _box(values: FloatArray, steps: int) -> FloatArray:
    """Means over steps + 1 points by the trapezoidal rule."""
    middles = 0.5 * (values[1:] + values[:-1])
    if steps == 1:
        return np.asarray(middles, np.float64)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(middles, axis=0)])
    return np.asarray((total[steps:] - total[:-steps]) / steps, np.float64)


def _normal(products: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal equations of M, (9, 9) and (9,). products (rows, 3, 3): u_b g_d; turned (rows, 3)."""
    flat = products.reshape(-1, 9)
    gram = (flat.T @ flat).reshape(3, 3, 3, 3)
    cross = (flat.T @ turned).reshape(3, 3, 3)
    matrix = np.einsum("abc,aef,bdeg->cdfg", _CROSS, _CROSS, gram, optimize=True).reshape(9, 9)
    return matrix, np.einsum("abc,bda->cd", _CROSS, cross).reshape(9)


def _rows(
    u: FloatArray, gyr: FloatArray, good: FloatArray, step_s: float, window: int, lag: int
) -> tuple[FloatArray, FloatArray]:
    """Products (rows, 3, 3) and what turned (rows, 3), with the roots of their weights. lag: in steps, kept inside by
    as many points at both ends as the longest."""
    most, every = round(LONGEST_LAG_S / step_s) + 1, max(1, window // 2)
    inside = slice(most, len(u) - most)
    smooth, weight = u[inside], good[inside]
    products = u[inside][:, :, None] * gyr[most + lag : len(u) - most + lag][:, None, :]
    for _ in range(2):
        smooth = _box(smooth, window)
    for _ in range(3):
        products, weight = _box(products, window), _box(weight, window)
    turned = (smooth[window:] - smooth[:-window]) / (window * step_s)
    root = np.sqrt(weight[::every])
    return products[::every] * root[:, None, None], turned[::every] * root[:, None]


def turning_of(u: FloatArray, gyr_dps: FloatArray, usable: BoolArray, step_s: float) -> Turning | None:
    """The regression on an even grid. u (n, 3): acceleration in units of its length at rest; gyr_dps (n, 3): as read;
    usable (n,): points that count. None for too few points."""
    most = round(LONGEST_LAG_S / step_s) + 1
    if len(u) < 8 * max(1, round(WINDOWS_S[-1] / step_s)) + 2 * most:
        return None
    cut = slice(0, len(u)) if len(u) <= MOST_POINTS else _busiest(gyr_dps)
    u, gyr, usable = u[cut], np.radians(gyr_dps[cut]), usable[cut]
    good = np.asarray(usable / (1.0 + ((np.linalg.norm(u, axis=1) - 1.0) / OFF_G) ** 2) ** 2, np.float64)
    steps = sorted({sign * lag for lag in LAGS for sign in (-1, 1) if lag < most}, key=abs)
    windows = sorted({max(1, round(one / step_s)) for one in WINDOWS_S})
    best: tuple[float, int, int, float, int] = (-1.0, 0, 0, 0.0, 1)
    as_read = 0.0
    # Every fourth lag chooses the length of the window, and every lag is then tried with that.
    for chosen in (steps[::4], steps):
        for window in windows:
            for lag in chosen:
                products, turned = _rows(u, gyr, good, step_s, window, lag)
                factors, shares = _shares(*_normal(products, turned), turned)
                axes = int(np.argmax(shares))
                as_read = max(as_read, float(shares[signed_axes.AS_READ]))
                if shares[axes] > best[0] + 1e-3:
                    best = (float(shares[axes]), axes, lag, float(factors[axes]), window)
        windows = [best[4]]
    share, axes, lag, factor, window = best
    products, turned = _rows(u, gyr, good, step_s, window, lag)
    predicted = np.einsum("abc,cd,nbd->na", _CROSS, factor * signed_axes.EVERY[axes], products)
    return Turning(share, axes, factor, lag * step_s, as_read, turned, predicted)


def screened(u: FloatArray, gyr_dps: FloatArray, step_s: float) -> Screened | None:
    """One regression of `turning_of`, without a lag and with one window: fast, and good for a question. None for too
    few points."""
    window, most = max(1, round(SCREEN_WINDOW_S / step_s)), round(LONGEST_LAG_S / step_s) + 1
    if len(u) < 8 * window + 2 * most:
        return None
    good = np.asarray(1.0 / (1.0 + ((np.linalg.norm(u, axis=1) - 1.0) / OFF_G) ** 2) ** 2, np.float64)
    products, turned = _rows(u, np.radians(gyr_dps), good, step_s, window, 0)
    factors, shares = _shares(*_normal(products, turned), turned)
    axes = int(np.argmax(shares))
    tied = bool(shares[signed_axes.AS_READ] >= SCREEN_TIE * shares[axes])
    return Screened(float(shares[axes]), float(factors[axes]), tied)


def _shares(matrix: FloatArray, vector: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factor k of each of the 48 P, 0 or more, and the share of the turning that it explains."""
    flat = signed_axes.EVERY.reshape(48, 9)
    bend, pull = np.einsum("pi,ij,pj->p", flat, matrix, flat), flat @ vector
    factors = np.where(pull > 0.0, pull / np.maximum(bend, 1e-300), 0.0)
    return factors, factors * pull / max(float(np.sum(turned**2)), 1e-300)


def _busiest(gyr: FloatArray) -> slice:
    """The stretch of MOST_POINTS with most turning."""
    energy = np.concatenate([[0.0], np.cumsum(np.sum((gyr - np.median(gyr, axis=0)) ** 2, axis=1))])
    first = int(np.argmax(energy[MOST_POINTS:] - energy[:-MOST_POINTS]))
    return slice(first, first + MOST_POINTS)

"""Does the gyro carry the accelerometer's readings into one frame, in which their mean is gravity?

Over a window the gyro's reading g is integrated as k P g to turns, and each reading of the accelerometer is turned back
to the beginning of the window. With the right factor k, axes P and lag the mean is 1 g long, because accelerations of
the body average out; with wrong ones it is not. This holds under accelerations that hide the turning from a regression,
but needs candidates for k. Not to turn the readings at all is a candidate, too: what it explains as well, was no turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import BoolArray, FloatArray

WINDOW_S = 2.0
PARTS = 4
MOST_WINDOWS = 48
"""Those with most turning."""
MOST_UNUSABLE = 0.3
"""Share of clipped points: the most turning is where they are."""
SURE_T = 4.0
"""Least mean of a difference between two candidates over windows, in standard errors."""


@dataclass(frozen=True)
class Windows:
    """starts: first points; u (n, 3): acceleration in g; rate (n, 3) rad/s; points of a window; step_s."""

    starts: FloatArray
    u: FloatArray
    rate: FloatArray
    points: int
    step_s: float


def windows_of(u: FloatArray, gyr_dps: FloatArray, usable: BoolArray, step_s: float, margin: int) -> Windows | None:
    """Windows with turning, of usable points but for MOST_UNUSABLE, `margin` points away from the ends; None for
    fewer than 6."""
    points = max(8, round(WINDOW_S / step_s))
    rate = np.radians(np.where(np.isfinite(gyr_dps), gyr_dps, 0.0))
    bad = np.concatenate([[0], np.cumsum(~usable)])
    energy = np.concatenate([[0.0], np.cumsum(np.sum((rate - np.median(rate, axis=0)) ** 2, axis=1))])
    starts = np.arange(margin, len(u) - points - margin, points // 2)
    whole = starts[bad[starts + points + margin] - bad[starts - margin] <= MOST_UNUSABLE * points]
    if len(whole) < 6:
        return None
    order = np.argsort(energy[whole] - energy[whole + points])
    chosen = np.sort(whole[order[:MOST_WINDOWS]])
    return Windows(chosen, np.where(np.isfinite(u), u, 0.0), rate, points, step_s)


def errors(windows: Windows, matrices: FloatArray, lags: FloatArray) -> FloatArray:
    """| |mean| - 1 | of every window (candidates, windows). matrices (candidates, 3, 3): k P; lags (candidates,): in
    points, positive for a gyro that is late."""
    starts = windows.starts[None, :] + np.zeros((len(matrices), 1), int)
    late = lags.astype(int)[:, None]
    turn = np.zeros((4, *starts.shape))
    turn[0] = 1.0
    parts = np.zeros((PARTS, 3, *starts.shape))
    half = 0.25 * windows.step_s
    transposed = np.swapaxes(matrices, 1, 2)
    previous = windows.rate[starts + late] @ transposed
    for point in range(windows.points):
        now = windows.rate[starts + late + point] @ transposed
        # Half of the turn of the mean rate between two points.
        v = half * (previous + now)
        angle = np.sqrt(np.sum(v * v, axis=2))
        scale = np.sinc(angle / np.pi)
        x, y, z = v[..., 0] * scale, v[..., 1] * scale, v[..., 2] * scale
        w = np.cos(angle)
        if point:
            a, b, c, d = turn
            turn = np.stack(
                [
                    a * w - b * x - c * y - d * z,
                    a * x + b * w + c * z - d * y,
                    a * y - b * z + c * w + d * x,
                    a * z + b * y - c * x + d * w,
                ]
            )
        parts[PARTS * point // windows.points] += _turned(turn, windows.u[windows.starts + point])
        previous = now
    means = parts * (PARTS / windows.points)
    apart = means - means.mean(axis=0)
    short = np.sqrt(np.sum(means.mean(axis=0) ** 2, axis=0)) - 1.0
    return np.asarray(np.sqrt(np.mean(np.sum(apart**2, axis=1), axis=0) + short**2), np.float64)


def _turned(q: FloatArray, u: FloatArray) -> FloatArray:
    """u (windows, 3) turned by q (4, candidates, windows) -> (3, candidates, windows)."""
    w, x, y, z = q
    a, b, c = u.T
    s, t, r = y * c - z * b, z * a - x * c, x * b - y * a
    return np.stack(
        [a + 2.0 * (w * s + y * r - z * t), b + 2.0 * (w * t + z * s - x * r), c + 2.0 * (w * r + x * t - y * s)]
    )


def t_of(difference: FloatArray) -> float:
    """Mean over windows in standard errors."""
    spread = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    return float(np.mean(difference) / max(spread, 1e-12))

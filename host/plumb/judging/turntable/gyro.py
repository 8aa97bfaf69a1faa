"""Attitude from the turntable's gyro alone, the baseline for fusion.

The bias is the mean over the rest; samples are interpolated linearly and integrated to a quaternion. Compensating the
lag adds lag * rate to the angle.
"""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.turntable.motion import REST_S
from plumb.systems.turntable.reference import multiply, rotation_deg, turned
from plumb.systems.turntable.scenarios import GYRO_LSB_PER_DPS, Scenario


def attitudes(time_s: FloatArray, rate_dps: FloatArray, lag_s: float = 0.0) -> FloatArray:
    """(samples, 4) from samples (samples, 3), the first at the start's attitude."""
    rate = rate_dps - rate_dps[time_s < REST_S].mean(axis=0)
    turns = (rate[1:] + rate[:-1]) / 2.0 * np.diff(time_s)[:, None] + lag_s * (rate[1:] - rate[:-1])
    turns[time_s[1:] < REST_S] = 0.0
    steps = turned(np.tile([1.0, 0.0, 0.0, 0.0], (len(turns), 1)), turns)
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    attitude = [(w, x, y, z)]
    for a, b, c, d in steps.tolist():
        w, x, y, z = (
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        )
        attitude.append((w, x, y, z))
    found = np.array(attitude)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True), np.float64)


def residuals_deg(run: Scenario, *, lag_s: float = 0.0, spikes: bool = False) -> FloatArray:
    """Rotation vector from the true to the gyro's attitude over the motion, deg, (samples, 3). spikes False: without
    spikes, as behind a perfect prefilter."""
    counts = run.gyro if spikes else run.gyro_clean
    attitude = attitudes(run.gyro_s, counts / GYRO_LSB_PER_DPS, lag_s)
    moving = run.gyro_s >= REST_S
    return rotation_deg(run.gyro_attitude[moving], attitude[moving])


def interpolated(attitude: FloatArray, share: FloatArray) -> FloatArray:
    """Interpolate between each attitude (share 0) and the one before it (share 1); (n, 4)."""
    before = np.vstack([attitude[:1], attitude[:-1]])
    step = multiply(attitude * np.array([1.0, -1.0, -1.0, -1.0]), before)
    weighted = (1.0 - share[:, None]) * np.array([1.0, 0.0, 0.0, 0.0]) + share[:, None] * step
    return multiply(attitude, weighted / np.linalg.norm(weighted, axis=1, keepdims=True))

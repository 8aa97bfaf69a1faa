"""Roll and pitch of a vertical in body axes.

Body axes are x to the front, y to the left, z up. Rotation order is heading, pitch, roll (z, y, x); a positive roll
lowers the right side, a positive pitch lowers the nose, both right-handed about their axis.
"""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray


def roll_deg(up: FloatArray) -> FloatArray:
    """up: the vertical in body axes, (N, 3). Returns (N,) deg, within +-180."""
    return np.asarray(np.degrees(np.arctan2(up[:, 1], up[:, 2])), np.float64)


def pitch_deg(up: FloatArray) -> FloatArray:
    """up: the vertical in body axes, (N, 3), of any length. Returns (N,) deg, within +-90."""
    return np.asarray(np.degrees(np.arctan2(-up[:, 0], np.hypot(up[:, 1], up[:, 2]))), np.float64)


def apart_deg(first: FloatArray, second: FloatArray) -> FloatArray:
    """Angle between two verticals, (N, 3) each, of any length. Returns (N,) deg; NaN where one is NaN."""
    cross = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(cross, np.einsum("ij,ij->i", first, second))), np.float64)

"""Roll, pitch and yaw of a unit quaternion w, x, y, z from body to earth.

Turned by yaw about z, then by pitch about y, then by roll about x, each right-handed. At a pitch of +-90 deg roll and
yaw are not determined. Arguments are arrays of one shape, results have it, in rad.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb.spec.arrays import FloatArray

Angle = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]


def roll(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """-pi to pi."""
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


def pitch(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """-pi/2 to pi/2."""
    return np.asarray(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)), np.float64)


def yaw(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """-pi to pi."""
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


ANGLES: dict[str, Angle] = {"roll": roll, "pitch": pitch, "yaw": yaw}

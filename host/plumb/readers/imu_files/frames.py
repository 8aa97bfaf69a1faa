"""The axes in which loggers write, and the turn to x front, y left, z up with the reaction to gravity (+1 g on z)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray

_HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class Frame:
    """axes (3, 3): rows are x front, y left, z up in the axes as written; accel_sign: -1 for an accelerometer that
    reads gravity; back: w, x, y, z, which turns from front, left, up to the axes as written; said: for people."""

    axes: tuple[tuple[int, int, int], ...]
    accel_sign: float
    back: tuple[float, float, float, float]
    said: str


_SCREEN = ((0, 1, 0), (-1, 0, 0), (0, 0, 1))
_SCREEN_BACK = (_HALF, 0.0, 0.0, _HALF)
FRAMES = {
    "flu": Frame(((1, 0, 0), (0, 1, 0), (0, 0, 1)), 1.0, (1.0, 0.0, 0.0, 0.0), "x front, y left, z up, as plumb has"),
    "frd": Frame(((1, 0, 0), (0, -1, 0), (0, 0, -1)), 1.0, (0.0, 1.0, 0.0, 0.0),
                 "x front, y right, z down; level at rest z reads -1 g"),
    "android": Frame(_SCREEN, 1.0, _SCREEN_BACK,
                     "x right, y to the upper edge, z out of the screen; face up z reads +1 g"),
    "ios": Frame(_SCREEN, -1.0, _SCREEN_BACK,
                 "x right, y to the upper edge, z out of the screen; face up z reads -1 g (Core Motion)"),
}  # fmt: skip
"""The front of a device with a screen is its upper edge."""


def turned(columns: dict[str, FloatArray], name: str) -> dict[str, FloatArray]:
    """Columns as `recording_files.read` returns them, from the frame of this name to front, left, up. The body's axes
    of a reference turn, its earth's do not."""
    frame = FRAMES[name]
    axes = np.array(frame.axes, np.float64)
    found = dict(columns)
    found["gyr"] = columns["gyr"] @ axes.T
    found["acc"] = frame.accel_sign * columns["acc"] @ axes.T
    if "ref_quat" in columns:
        w, x, y, z = columns["ref_quat"].T
        a, b, c, d = frame.back
        found["ref_quat"] = np.stack(
            [
                w * a - x * b - y * c - z * d,
                w * b + x * a + y * d - z * c,
                w * c - x * d + y * a + z * b,
                w * d + x * c - y * b + z * a,
            ],
            1,
        )
    return found

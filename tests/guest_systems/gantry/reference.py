"""`gantry` in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from plumb.systems.gantry.tuning import GantryTuning


def run_control(
    tuning: GantryTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """raw: (steps, 9), encoders and commands. Gives path_x, path_y and path_z, (steps,), in counts."""
    inputs = np.asarray(raw, np.int64)
    x = np.zeros(len(inputs)) if setpoint is None else np.asarray(setpoint, np.float64)
    asked = (x, inputs[:, 6].astype(np.float64), (inputs[:, 8] * 65536 + (inputs[:, 7] & 0xFFFF)).astype(np.float64))
    found = {}
    for name, places in zip("xyz", asked, strict=True):
        path, at = np.zeros(len(inputs)), 0.0
        for step, place in enumerate(places):
            at += min(max(place - at, -tuning.most_counts), tuning.most_counts)
            path[step] = at
        found[f"path_{name}"] = path
    return found

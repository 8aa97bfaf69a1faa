"""`toy` in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from plumb.systems.toy.tuning import ToyTuning


def run_control(
    tuning: ToyTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """raw: (steps, 1 or more). Gives filtered_counts, (steps,)."""
    counts = np.clip(np.asarray(raw, np.float64)[:, 0], 0.0, tuning.largest_counts)
    filtered, level = [], 0.0
    for count in counts:
        level += tuning.share * (count - level)
        filtered.append(level)
    return {"filtered_counts": np.array(filtered)}

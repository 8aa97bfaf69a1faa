"""`toy` in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from plumb.systems.toy.tuning import ToyTuning


def run_control(
    tuning: ToyTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """raw: (steps, 1 or more). Gives filtered_counts, (steps,)."""
    inputs = np.asarray(raw, np.float64)
    counts = np.clip(inputs[:, 0], 0.0, tuning.largest_counts)
    held = inputs[:, 13] != 0 if inputs.shape[1] > 13 else np.zeros(len(inputs), np.bool_)
    filtered, level = [], 0.0
    for count, stays in zip(counts, held, strict=True):
        level += 0.0 if stays else tuning.share * (count - level)
        filtered.append(level)
    return {"filtered_counts": np.array(filtered)}

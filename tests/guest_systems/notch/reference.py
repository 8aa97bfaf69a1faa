"""`notch` in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from plumb.systems.notch.tuning import NotchTuning


def run_control(
    tuning: NotchTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """raw: (steps, 1 or more). Gives filtered_counts, (steps,)."""
    counts = np.clip(np.asarray(raw, np.float64)[:, 0], 0.0, 4095.0)
    b0, b1, a2 = tuning.coefficients()
    filtered = np.zeros(len(counts))
    for step, count in enumerate(counts):
        in_1, in_2 = (counts[step - back] if step >= back else 0.0 for back in (1, 2))
        out_1, out_2 = (filtered[step - back] if step >= back else 0.0 for back in (1, 2))
        filtered[step] = b0 * (count + in_2) + b1 * (in_1 - out_1) - a2 * out_2
    return {"filtered_counts": filtered}

"""`current` in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from plumb.systems.current.tuning import CurrentTuning


def run_control(
    tuning: CurrentTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """raw: (steps, 1 or more). Gives current_a and duty, (steps,)."""
    counts = np.clip(np.asarray(raw, np.float64)[:, 0], 0.0, 4095.0)
    current_a = (counts - tuning.zero_counts) * tuning.amps_per_count
    asked_a = np.zeros(len(counts)) if setpoint is None else np.asarray(setpoint, np.float64) / 2**20
    duty, integral = np.zeros(len(counts)), 0.0
    for step, error in enumerate(np.clip(asked_a, -64.0, 64.0) - current_a):
        integral = min(max(integral + tuning.ki_per_a_s * tuning.period_s * error, -1.0), 1.0)
        duty[step] = min(max(tuning.kp_per_a * error + integral, -tuning.duty_max), tuning.duty_max)
    return {"current_a": current_a, "duty": duty}

"""The papers' equations in float64, as printed: the truth that fixed point is measured against.

A system is a module of its own here; what systems share is in `kernels`. It runs on a tuning: a person's, or the
dequantised one of the integers, so that only the arithmetic differs from `plumb.systems.run_fixed`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference.kernels import (
    KalmanState,
    Number,
    PidState,
    asin,
    atan2,
    calibrate,
    clip,
    kalman_init,
    kalman_step,
    pid_step,
    tilt,
    trust,
    wrap,
)
from plumb.spec.tuning import AnyTuning
from plumb.systems import load
from plumb.systems.contracts import REFERENCE
from plumb.tuning.quantise import ControlParams, dequantise

__all__ = [
    "KalmanState", "Number", "PidState", "asin", "atan2", "calibrate", "clip", "kalman_init", "kalman_step", "pid_step",
    "run_control", "tilt", "trust", "wrap",
]  # fmt: skip


def run_control(
    settings: AnyTuning | ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """A run of the system that the settings are of, from counts. raw: (steps, counts[, runs]); setpoint: (steps[,
    runs]) in the integers of the system, 0 when left out. Float arrays (steps[, runs]) by name; which, the system says.
    """
    tuning = dequantise(settings) if isinstance(settings, ControlParams) else settings
    system = load(tuning.system, REFERENCE)
    return system.run_control(tuning, raw, setpoint)

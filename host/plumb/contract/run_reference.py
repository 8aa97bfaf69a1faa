"""Run a system's reference model: the published equations in float64, against which fixed point is measured.

The model is the system's reference.py; the shared kernels are in `plumb.kernels.reference`. With the dequantised tuning
of a parameter set, it differs from `plumb.contract.run_fixed` in the arithmetic alone.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import ControlParams, dequantise
from plumb.contract.step import REFERENCE
from plumb.spec import declarations
from plumb.spec.system_parts import load
from plumb.spec.tuning import AnyTuning


def run_control(
    settings: AnyTuning | ControlParams, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, npt.NDArray[np.float64]]:
    """Run the reference model on raw counts; returns float arrays (steps[, runs]) by name, as the system defines them.

    raw: (steps, counts[, runs]), with or without room for other systems; setpoint: (steps[, runs]) in the integers of
    the system, default 0.
    """
    tuning = dequantise(settings) if isinstance(settings, ControlParams) else settings
    system = load(tuning.system, REFERENCE)
    return system.run_control(tuning, np.asarray(raw)[:, : declarations.system(tuning.system).inputs], setpoint)

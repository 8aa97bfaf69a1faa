"""Angles that `quad` makes of one axis of a recording."""

from __future__ import annotations

import numpy as np

from plumb.contract.parameters import ControlParams
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.tuning.variances import lsb_of

TURN_DEG, RATE_DPS = 360.0 / 2.0**32, 360.0 / 2.0**28
"""Degrees in a unit of a binary angle, degrees per second in a unit of a rate."""


def angles(words: Words, params: ControlParams, axis: str) -> dict[str, FloatArray]:
    """The tilt about the axis, its rate, the gyro's bias, and the filter's own standard deviation."""
    return {
        f"tilt_{axis}_deg": np.asarray(words["tilt_turn_q32"] * TURN_DEG, np.float64),
        f"rate_{axis}_dps": np.asarray(words["rate_corrected_turnps_q28"] * RATE_DPS, np.float64),
        f"bias_{axis}_dps": np.asarray(words["bias_turnps_q28"] * RATE_DPS, np.float64),
        "sigma_deg": np.sqrt(np.maximum(words["p00"].astype(np.float64), 0.0) * lsb_of(params)),
    }

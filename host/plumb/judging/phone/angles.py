"""Angles that `phone` makes of a recording."""

from __future__ import annotations

import numpy as np

from plumb.contract.parameters import ControlParams
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.tuning.variances import lsb_of

TURN_DEG, RATE_DPS = 360.0 / 2.0**32, 360.0 / 2.0**28
"""Degrees in a unit of a binary angle, degrees per second in a unit of a rate."""


def angles(words: Words, params: ControlParams, _axis: str) -> dict[str, FloatArray]:
    """Roll and pitch as the phone's own axes define them (docs/systems/phone.md), rates, biases, and the standard
    deviation that each of the two filters states."""
    found: dict[str, FloatArray] = {}
    for angle in ("roll", "pitch"):
        variance = np.maximum(words[f"{angle}_p00"].astype(np.float64), 0.0)
        found |= {
            f"{angle}_deg": np.asarray(words[f"{angle}_turn_q32"] * TURN_DEG, np.float64),
            f"{angle}_rate_dps": np.asarray(words[f"{angle}_rate_corrected_turnps_q28"] * RATE_DPS, np.float64),
            f"{angle}_sigma_deg": np.sqrt(variance * lsb_of(params)),
            f"{angle}_bias_dps": np.asarray(words[f"{angle}_bias_turnps_q28"] * RATE_DPS, np.float64),
        }
    return found

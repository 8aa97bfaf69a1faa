"""Angles that `attitude` makes of a recording."""

from __future__ import annotations

import numpy as np

from plumb.analyses.estimation import verticals
from plumb.analyses.estimation.estimated import UP
from plumb.contract.parameters import ControlParams
from plumb.spec import quaternion_angles
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words

RATE_DPS, BIAS_DPS = 360.0 / 2.0**28, 360.0 / 2.0**32
"""Degrees per second in a unit of a rate, and of a bias."""
AXES = ("x", "y", "z")


def angles(words: Words, _params: ControlParams, _axis: str) -> dict[str, FloatArray]:
    """Roll and pitch of the vertical; heading from the start, which is the gyro's alone; rate about the vertical; sigma
    of the tilt, both of its components together."""
    up = np.stack([words[f"up_q30_{i}"] for i in range(3)], 1) / 2.0**30
    rates = np.stack([words[f"rate_turnps_q28_{i}"] for i in range(3)], 1) * RATE_DPS
    w, x, y, z = (words[f"attitude_{part}_q30"] / 2.0**30 for part in "wxyz")
    found = {
        "roll_deg": verticals.roll_deg(up),
        "pitch_deg": verticals.pitch_deg(up),
        "heading_deg": np.asarray(np.degrees(quaternion_angles.yaw(w, x, y, z)), np.float64),
        "yaw_rate_dps": np.einsum("ij,ij->i", up, rates),
        "sigma_deg": np.degrees(np.sqrt(words["tilt_variance_rad2_q32"] / 2.0**32)),
    }
    found |= dict(zip(UP, up.T, strict=True))
    return found | {f"bias_{axis}_dps": words[f"bias_turnps_q32_{i}"] * BIAS_DPS for i, axis in enumerate(AXES)}

"""Which samples of a run are scored."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

SCORE_FROM_S = 10.0
"""Start of the scored part: the scenarios begin at rest, while the filter converges."""


def scored(time_s: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """True for the samples that count, (steps,): t >= 10 s, or the second half of a run under 20 s."""
    end_s = time_s[-1] + (time_s[1] - time_s[0] if len(time_s) > 1 else 0.0)
    return np.asarray(time_s >= (SCORE_FROM_S if end_s >= 2.0 * SCORE_FROM_S - 1e-9 else end_s / 2.0) - 1e-9)

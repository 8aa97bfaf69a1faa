"""Types of numpy arrays that signatures name."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
"""float64; shape and unit stand where it is used."""
BoolArray = npt.NDArray[np.bool_]
"""Truth values; the shape stands where it is used."""

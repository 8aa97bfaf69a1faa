"""Samples that a grade loses, drawn from a seed: (N,) booleans for N samples of one period."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
Loss = Callable[[int, float, np.random.Generator], BoolArray]
"""Number of samples, their period in s, and the draw."""

GAP_S, GAP_EVERY_S = 0.1, 10.0


def share(lost: float) -> Loss:
    """Each sample is lost with this probability, independently of the others."""

    def drawn(samples: int, _period_s: float, rng: np.random.Generator) -> BoolArray:
        return rng.random(samples) < lost

    return drawn


def gaps(samples: int, period_s: float, rng: np.random.Generator) -> BoolArray:
    """A gap of GAP_S every GAP_EVERY_S; where the first one lies is drawn."""
    into_s = np.mod(np.arange(samples) * period_s - rng.uniform(0.0, GAP_EVERY_S), GAP_EVERY_S)
    return np.asarray(into_s < GAP_S, np.bool_)

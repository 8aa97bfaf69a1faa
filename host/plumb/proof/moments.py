"""Moments of a run in the order of its steps: what lasts behind an event."""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import BoolArray


def behind(on: BoolArray, steps: int) -> BoolArray:
    """(steps of the run,): True where it is or was true at most so many steps ago."""
    places = np.arange(len(on))
    last = np.maximum.accumulate(np.where(on, places, -steps - 1))
    return np.asarray(places - last <= steps)

"""Other estimators on the samples that the board took: VQF and Mahony, as `plumb compare --flights` has them."""

from __future__ import annotations

import numpy as np

from plumb.analyses.flights.estimators import estimators
from plumb.cockpit.samples import Samples
from plumb.errors import UsageError
from plumb.systems.steered import Steered

NAMES = ("VQF", "Mahony")
AXES = 6
"""Raw counts of gyro and accelerometer, the first of a step."""
NO_SAMPLE = -32768


class Rivals:
    """verticals: of each estimator, in body axes, by name; {} where their package is not installed."""

    def __init__(self, steered: Steered, period_us: int) -> None:
        self.verticals: dict[str, list[float]] = {}
        self._next = 0
        try:
            found = estimators(NAMES)
        except UsageError:
            found = ()
        self._each = {one.name: one.begin(steered.IMU, steered.AIRFRAME, period_us, 1) for one in found}

    def follow(self, samples: Samples, thrust: float) -> None:
        """Take the steps that have come. thrust: mean command of the motors, 0 to 1."""
        counts, self._next = samples.raw_since(self._next, AXES)
        whole = np.isfinite(counts).all(1) & (counts[:, 0] != NO_SAMPLE)
        for row in counts[whole].astype(np.int16):
            for name, one in self._each.items():
                (vertical,) = one.step(row[None], np.array([thrust]))
                self.verticals[name] = [round(float(value), 5) for value in vertical]

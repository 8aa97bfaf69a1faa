"""Other estimators on the samples that the board took: VQF and Mahony, as `plumb compare --flights` has them."""

from __future__ import annotations

import numpy as np

from plumb.analyses.flights.estimators import rival
from plumb.cockpit.samples import Samples
from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.systems.steered import Steered, SteeredVehicle

NAMES = ("VQF", "Mahony")
NO_SAMPLE = -32768


class Rivals:
    """verticals: of each estimator, in body axes, by name; {} where their package is not installed."""

    def __init__(self, steered: Steered, period_us: int) -> None:
        self.verticals: dict[str, list[float]] = {}
        self._next = 0
        try:
            self._each = {name: rival(name, steered.IMU, period_us, 1) for name in NAMES}
        except UsageError:
            self._each = {}

    def follow(self, samples: Samples, vehicle: SteeredVehicle, *, moves: bool) -> None:
        """Take the steps that have come. moves: whether the motors are on; until then Mahony learns the bias."""
        channels = len(declarations.system(samples.system).channels)
        rows, self._next = samples.raw_since(self._next, channels)
        whole = np.isfinite(rows).all(1) & (rows[:, 0] != NO_SAMPLE)
        for taken in rows[whole].astype(int).tolist():
            counts = vehicle.sample_of(taken)
            if counts is None:
                continue
            row = np.array([counts], np.int16)
            for name, one in self._each.items():
                (vertical,) = one.step(row, np.array([float(moves)]))
                self.verticals[name] = [round(float(value), 5) for value in vertical]

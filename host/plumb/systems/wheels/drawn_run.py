"""A run of `wheels` with all its random values, drawn from its seed, and its prescribed motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plumb.physics.sensors import Fault
from plumb.spec.arrays import FloatArray
from plumb.systems.prescribed import Steps
from plumb.systems.wheels.rides import Ride
from plumb.systems.wheels.tuning import WheelsTuning


@dataclass(frozen=True)
class Prescribed:
    """A ride of the ideal controller: inputs of every step, and the truth by name."""

    raw: npt.NDArray[np.int16]
    speed_q15: npt.NDArray[np.int32]
    truth: dict[str, FloatArray]


@dataclass(frozen=True)
class Scenario(Steps):
    """One run. Grid: push_radps2, of every GRID_S. Samples: asked_mps, asked_dps; white: (steps, 6), of the sensors;
    vibration_g: (steps, 3); fault_noise: (channels, steps). imu: unit normal errors of the sensors; supply: battery by
    its nominal voltage. ideal: gives the ride of the ideal controller in this run. events: how many were drawn."""

    name: str
    seed: int
    period_us: int
    ride: Ride
    imu: FloatArray
    supply: float
    push_radps2: FloatArray
    asked_mps: FloatArray
    asked_dps: FloatArray
    white: FloatArray
    vibration_g: FloatArray
    fault_noise: FloatArray
    ideal: Callable[[Scenario], Prescribed]
    faults: tuple[Fault, ...] = ()
    events: int = 0

    @property
    def steps(self) -> int:
        return len(self.white)

    def fit(self, tuning: WheelsTuning) -> WheelsTuning:
        """The tuning with the period of this run."""
        return replace(tuning, period_us=self.period_us)

    @cached_property
    def prescribed(self) -> Prescribed:
        """The ride of the ideal controller."""
        return self.ideal(self)

    def counts(self) -> npt.NDArray[np.int16]:
        """All inputs of the prescribed ride, (steps, 15)."""
        return self.prescribed.raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Speed that the prescribed ride asks for, Q15, (steps,)."""
        return self.prescribed.speed_q15

    def truth(self) -> dict[str, FloatArray]:
        return self.prescribed.truth

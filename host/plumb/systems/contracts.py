"""What every system's scenarios and plants offer, as types; `plumb.systems` says what a system's folder holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Conversion(NamedTuple):
    """A sample that the board took of the first raw channel. time_s: on the machine's clock; truth: at that moment."""

    time_s: float
    raw_count: int
    truth: dict[str, float]


class Scenario(Protocol):
    """Everything random of one run, drawn from its seed."""

    @property
    def period_us(self) -> int:
        """Sampling period."""

    @property
    def steps(self) -> int:
        """Samples of the run."""

    @property
    def time_s(self) -> FloatArray:
        """When the samples are taken, (steps,)."""

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """The samples that count for the figures, (steps,)."""

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of the prescribed motion, (steps, 6)."""

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Setpoints in the integers of the system, (steps,)."""

    def truth(self) -> dict[str, FloatArray]:
        """The prescribed motion by name, (steps,) each."""


class Plant(Protocol):
    """The physics, and the sensors that ride on it."""

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with the signals of the last step; {}: none yet."""

    def counts(self, time_s: float) -> tuple[int, ...]:
        """Six raw counts at time_s."""

    def truth(self, time_s: float) -> dict[str, float]:
        """The true state at time_s by name."""

    def setpoint(self, time_s: float) -> int:
        """The setpoint at time_s, in the integers of the system."""


class Coupling(Protocol):
    """A plant joined to the pins of a simulated machine."""

    taken: list[Conversion]
    """The samples that the board took, in order of time."""

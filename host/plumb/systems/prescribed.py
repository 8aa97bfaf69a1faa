"""Runs of prescribed motion: their steps in time, faults in their counts, and the plant that plays them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.physics.sensors import Fault
from plumb.spec.arrays import FloatArray
from plumb.systems import scoring


class Steps(ABC):
    """The steps of a run in time."""

    period_us: int

    @property
    @abstractmethod
    def steps(self) -> int: ...

    @property
    def time_s(self) -> FloatArray:
        """Sampling instants, (steps,)."""
        return np.arange(self.steps, dtype=np.float64) * (self.period_us * 1e-6)

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """The samples that count, (steps,)."""
        return scoring.scored(self.time_s)


def put_faults(
    raw: npt.NDArray[np.int16], faults: Iterable[Fault], time_s: FloatArray, fault_noise: FloatArray
) -> None:
    """Put faults into the counts of a whole run, (steps, channels). fault_noise: (channels, steps)."""
    for fault in faults:
        begun = int(np.searchsorted(time_s, fault.start_s))
        if begun < len(time_s):
            at_start, noise = int(raw[begun, fault.channel]), fault_noise[fault.channel]
            raw[:, fault.channel] = fault.counts(raw[:, fault.channel], time_s, at_start, noise)


@dataclass(frozen=True)
class Playback:
    """Plays the samples of a run again and again; the outputs of a board have no effect.

    samples: raw counts, (steps, channels). known: the truth of each step by name, (steps,) each.
    """

    period_us: int
    samples: npt.NDArray[np.int16]
    known: Mapping[str, FloatArray]

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Does nothing: the outputs have no effect."""

    def counts(self, time_s: float) -> tuple[int, ...]:
        """The raw counts of the sample at time_s."""
        return tuple(self.samples[self.step_at(time_s)].tolist())

    def truth(self, time_s: float) -> dict[str, float]:
        return {name: float(values[self.step_at(time_s)]) for name, values in self.known.items()}

    def setpoint(self, time_s: float) -> int:
        return 0

    def step_at(self, time_s: float) -> int:
        """The step of a time; after the last comes the first."""
        return round(time_s * 1e6 / self.period_us) % len(self.samples)

"""`current`: a winding on 12 V, and setpoints that step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from plumb.systems.current.tuning import PERIOD_US, CurrentTuning

from plumb.errors import UsageError
from plumb.systems.prescribed import Steps

SCENARIOS = {
    "steps": "0 A, 2 A, -1 A, 0 A, a second each",
    "short": "the same, and from 0.5 s on a short circuit drives 60 A",
    "flowing": "the same, and 1 A flows through the shunt before anything is driven",
}
SECONDS = dict.fromkeys(SCENARIOS, 12.0)
DEFAULT_SCENARIO = "steps"
TUNINGS = {"plain": CurrentTuning()}
TUNING_NOTES = {"plain": "for a winding of 1 mH and 0.5 ohm on 12 V"}
DEFAULT_TUNING = "plain"
LINK = {"pins": 1}
VOLTS, OHMS, HENRIES = 12.0, 0.5, 1e-3
AMPS_PER_COUNT = 5120 / 2**20
ASKED_A = (0.0, 2.0, -1.0, 0.0)


@dataclass(frozen=True)
class Scenario(Steps):
    name: str
    period_us: int
    noise_counts: npt.NDArray[np.float64]

    @property
    def steps(self) -> int:
        return len(self.noise_counts)

    def asked_a(self, time_s: float) -> float:
        return ASKED_A[int(time_s + 1e-9) % len(ASKED_A)]

    def foreign_a(self, time_s: float) -> float:
        """Current through the shunt that is not the winding's."""
        return {"short": 60.0 if time_s >= 0.5 else 0.0, "flowing": 1.0}.get(self.name, 0.0)

    def counts(self) -> npt.NDArray[np.int16]:
        raw = np.zeros((self.steps, 6), np.int16)
        raw[:, 0] = np.rint(2048 + self.truth()["current_a"] / AMPS_PER_COUNT + self.noise_counts)
        return raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        return np.array([round(self.asked_a(time) * 2**20) for time in self.time_s], np.int32)

    def truth(self) -> dict[str, npt.NDArray[np.float64]]:
        return {"current_a": np.array([self.asked_a(time) + self.foreign_a(time) for time in self.time_s])}


class Plant:
    """The winding: current in A, between two steps at a constant voltage. open_loop: the current is that asked for."""

    def __init__(self, run: Scenario, open_loop: bool) -> None:
        self.run, self._open_loop = run, open_loop
        self.period_us, self._current_a, self._time_s = run.period_us, 0.0, 0.0

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        self.drive_to(time_s, outputs.get("duty_q15", 0) / 2**15)

    def drive_to(self, time_s: float, share: float) -> None:
        """Simulate up to time_s with this share of the supply at the winding."""
        volts = VOLTS * share
        kept = math.exp(-(time_s - self._time_s) * OHMS / HENRIES)
        self._current_a = self._current_a * kept + volts / OHMS * (1.0 - kept)
        self._time_s = time_s
        if self._open_loop:
            self._current_a = self.run.asked_a(time_s)

    def counts(self, time_s: float) -> tuple[int, ...]:
        noise = float(self.run.noise_counts[round(time_s * 1e6 / self.period_us) % self.run.steps])
        count = round(2048 + (self._current_a + self.run.foreign_a(time_s)) / AMPS_PER_COUNT + noise)
        return (min(max(count, 0), 4095), 0, 0, 0, 0, 0)

    def truth(self, time_s: float) -> dict[str, float]:
        return {"current_a": self._current_a + self.run.foreign_a(time_s)}

    def setpoint(self, time_s: float) -> int:
        return round(self.run.asked_a(time_s) * 2**20)


def plant(run: Scenario, *, open_loop: bool = False) -> Plant:
    return Plant(run, open_loop)


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[object, ...] = (),
) -> Scenario:
    if name not in SCENARIOS:
        raise UsageError(f"current has no scenario '{name}'; it has {', '.join(SCENARIOS)}")
    steps = round((SECONDS[name] if seconds is None else seconds) * 1e6 / period_us)
    return Scenario(name, period_us, np.random.default_rng(seed).standard_normal(steps))

"""`notch`: a slow wave with the hum of the mains on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from plumb.systems.notch.tuning import PERIOD_US, NotchTuning

from plumb.errors import UsageError
from plumb.systems.prescribed import Playback, Steps

SCENARIOS = {"hum": "a wave of 2 Hz, with a hum of 50 Hz"}
SECONDS = {"hum": 12.0}
DEFAULT_SCENARIO = "hum"
TUNINGS = {"mains": NotchTuning()}
TUNING_NOTES = {"mains": "50 Hz, 20 Hz wide"}
DEFAULT_TUNING = "mains"


@dataclass(frozen=True)
class Scenario(Steps):
    period_us: int
    wave_counts: npt.NDArray[np.float64]
    hum_counts: npt.NDArray[np.float64]

    @property
    def steps(self) -> int:
        return len(self.wave_counts)

    def counts(self) -> npt.NDArray[np.int16]:
        raw = np.zeros((self.steps, 6), np.int16)
        raw[:, 0] = np.rint(self.wave_counts + self.hum_counts)
        return raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        return np.zeros(self.steps, np.int32)

    def truth(self) -> dict[str, npt.NDArray[np.float64]]:
        return {"wave_counts": self.wave_counts}


def plant(run: Scenario, *, open_loop: bool = True) -> Playback:
    return Playback(run.period_us, run.counts(), run.truth())


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[object, ...] = (),
) -> Scenario:
    if name not in SCENARIOS:
        raise UsageError(f"notch has no scenario '{name}'; it has {', '.join(SCENARIOS)}")
    steps = round((SECONDS[name] if seconds is None else seconds) * 1e6 / period_us)
    time_s, chance = np.arange(steps) * (period_us * 1e-6), np.random.default_rng(seed)
    begin = chance.uniform(0.0, 1.0)
    hum = 300.0 * np.sin(2.0 * np.pi * (50.0 * time_s + begin)) + chance.standard_normal(steps)
    return Scenario(period_us, 2048.0 + 1000.0 * np.sin(2.0 * np.pi * 2.0 * time_s), hum)

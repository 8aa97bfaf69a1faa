"""`toy`: a level that jumps up and down, and noise; wheels that turn, and commands that change twice a second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from plumb.systems.toy.tuning import PERIOD_US, ToyTuning

from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.systems.prescribed import Playback, Steps

SCENARIOS = {"jumps": "between 1000 and 3000 counts, every second"}
SECONDS = {"jumps": 20.0}
DEFAULT_SCENARIO = "jumps"
TUNINGS = {"slow": ToyTuning(), "fast": ToyTuning(share=0.5)}
TUNING_NOTES = {"slow": "a tenth of each count", "fast": "half of each count"}
DEFAULT_TUNING = "slow"


@dataclass(frozen=True)
class Scenario(Steps):
    period_us: int
    level_counts: npt.NDArray[np.float64]
    noise_counts: npt.NDArray[np.float64]

    @property
    def steps(self) -> int:
        return len(self.level_counts)

    def counts(self) -> npt.NDArray[np.int16]:
        declared = declarations.system("toy")
        raw = np.zeros((self.steps, declared.inputs), np.int16)
        raw[:, 0] = np.rint(self.level_counts + self.noise_counts)
        raw[:, 1:9] = (np.arange(self.steps)[:, None] * np.arange(1, 9)) % 4096
        for step in range(self.steps):
            raw[step, declared.counts :] = declared.pack_commands(commands(step))
        return raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        return np.full(self.steps, 2000 << 16, np.int32)

    def truth(self) -> dict[str, npt.NDArray[np.float64]]:
        return {"level_counts": self.level_counts}


def commands(step: int) -> dict[str, int]:
    """Commands of a step: other ones every 50 steps."""
    part = step // 50
    return {
        "gain": part % 7 - 3,
        "heading": (part * 123_456_789 + (1 << 30)) % (1 << 31) - (1 << 30),
        "trim": part % 201 - 100,
        "hold": part % 3 // 2,
        "mode": part % 3,
    }


class Plant(Playback):
    """The prescribed level."""

    def setpoint(self, time_s: float) -> int:
        return 2000 << 16


def plant(run: Scenario, *, open_loop: bool = True) -> Plant:
    return Plant(run.period_us, run.counts(), run.truth())


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[object, ...] = (),
) -> Scenario:
    if name not in SCENARIOS:
        raise UsageError(f"toy has no scenario '{name}'; it has {', '.join(SCENARIOS)}")
    steps = round((SECONDS[name] if seconds is None else seconds) * 1e6 / period_us)
    time_s = np.arange(steps) * (period_us * 1e-6)
    level = np.where(time_s % 2.0 < 1.0, 1000.0, 3000.0)
    return Scenario(period_us, level, 20.0 * np.random.default_rng(seed).standard_normal(steps))

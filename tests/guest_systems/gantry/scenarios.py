"""`gantry`: three places that change every two seconds, each slide's at another time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from plumb.systems.gantry.tuning import PERIOD_US, GantryTuning

from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.systems.prescribed import Playback, Steps

SCENARIOS = {"places": "other places every two seconds"}
SECONDS = {"places": 20.0}
DEFAULT_SCENARIO = "places"
TUNINGS = {"calm": GantryTuning(), "quick": GantryTuning(most_counts=400)}
TUNING_NOTES = {"calm": "4000 counts a second", "quick": "ten times that"}
DEFAULT_TUNING = "calm"


@dataclass(frozen=True)
class Scenario(Steps):
    period_us: int
    places: npt.NDArray[np.int64]  # (steps, 3)

    @property
    def steps(self) -> int:
        return len(self.places)

    def counts(self) -> npt.NDArray[np.int16]:
        declared = declarations.system("gantry")
        raw = np.zeros((self.steps, declared.inputs), np.int16)
        raw[:, :3] = np.clip(self.places, -32768, 32767)
        for step, (_, y, z) in enumerate(self.places.tolist()):
            raw[step, declared.counts :] = declared.pack_commands({"setpoint_y": y, "setpoint_z": z})
        return raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        return self.places[:, 0].astype(np.int32)

    def truth(self) -> dict[str, npt.NDArray[np.float64]]:
        return {f"place_{name}": self.places[:, i].astype(np.float64) for i, name in enumerate("xyz")}


class Plant(Playback):
    """The prescribed places; those of the setpoint are handed over with each step."""

    def setpoint(self, time_s: float) -> int:
        return round(self.truth(time_s)["place_x"])


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
        raise UsageError(f"gantry has no scenario '{name}'; it has {', '.join(SCENARIOS)}")
    steps = round((SECONDS[name] if seconds is None else seconds) * 1e6 / period_us)
    parts = (np.arange(steps)[:, None] * (period_us * 1e-6) + np.array([0.0, 0.7, 1.4])) // 2.0
    drawn = np.random.default_rng(seed).integers(-20000, 20001, (int(parts.max()) + 1 if steps else 1, 3))
    return Scenario(period_us, np.take_along_axis(drawn, parts.astype(np.int64), axis=0) * np.array([1, 1, 50]))

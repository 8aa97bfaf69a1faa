"""The recipe of the golden vectors: which inputs, which parameters, how many steps.

tests/vectors/recipe.toml, a [[vector]] table each:

    name        also the file's name
    system      a system's name
    tuning      a shipped tuning of that system, by name
    set         optional: dotted fields of the tuning to change, for example {"kalman.q_angle_deg2_per_s" = 10.0}
    scenario    a scenario of that system, with `seed`; or
    wild        a kind of input that no sensor gives, with `seed`: see WILD
    steps       how many
    on_link     optional: also run over a link
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards import RawCounts, Setpoints
from plumb.errors import UsageError
from plumb.quantise import ControlParams, quantise

UInt64Array = npt.NDArray[np.uint64]
EXTREME_COUNTS = np.array([-32768, -32767, -4096, -1, 0, 1, 1675, 2047, 2048, 4094, 4095, 4096, 32766, 32767])
EXTREME_ANGLES = np.array([0, 1, -1, 2**29, -(2**29), 2**30, -(2**30), 2**31 - 1, -(2**31), -(2**31) + 1])


def random_bits(seed: int, count: int, stream: int = 0) -> UInt64Array:
    """SplitMix64 (Steele, Lea, Flood 2014): the same numbers with every version of every library."""
    mix = np.arange(1, count + 1, dtype=np.uint64)
    with np.errstate(over="ignore"):
        mix = mix * np.uint64(0x9E3779B97F4A7C15) + np.uint64((seed * 1_000_003 + stream * 7919) % 2**64)
        mix = (mix ^ (mix >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mix = (mix ^ (mix >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mix ^ (mix >> np.uint64(31))


def _counts(seed: int, steps: int) -> npt.NDArray[np.int64]:
    return (random_bits(seed, steps * 6) >> np.uint64(48)).astype(np.int64).reshape(steps, 6) - 32768


def _angles(seed: int, steps: int) -> npt.NDArray[np.int64]:
    return (random_bits(seed, steps, 1) >> np.uint64(32)).astype(np.int64) - 2**31


def _held(values: npt.NDArray[np.int64], seed: int, longest: int) -> npt.NDArray[np.int64]:
    """Every row held for 1 to `longest` steps."""
    lengths = (random_bits(seed, len(values), 2) % np.uint64(longest)).astype(np.int64) + 1
    return np.repeat(values, lengths, axis=0)[: len(values)]


def _uniform(seed: int, steps: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Every 16-bit count, every 32-bit setpoint, no step like the last."""
    return _counts(seed, steps), _angles(seed, steps)


def _extremes(seed: int, steps: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Limits of the formats and of the converter, and their neighbours, held for up to 20 steps."""
    counts = EXTREME_COUNTS[_counts(seed, steps) % len(EXTREME_COUNTS)]
    angles = EXTREME_ANGLES[_angles(seed, steps) % len(EXTREME_ANGLES)]
    return _held(counts, seed, 20), _held(angles, seed + 1, 50)


def _steps(seed: int, steps: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """12-bit counts that jump, then rest for up to 200 steps."""
    return _held(_counts(seed, steps) & 4095, seed, 200), _held(_angles(seed, steps), seed + 1, 300)


def _walk(seed: int, steps: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """12-bit counts that wander from rail to rail, and a setpoint that turns round and round."""
    wander = np.cumsum(_counts(seed, steps) % 129 - 64, axis=0) + 2048
    folded = np.abs((wander + 4095) % 8190 - 4095)
    return folded, ((np.cumsum(_angles(seed, steps) // 64) + 2**31) % 2**32) - 2**31


def _spin(seed: int, steps: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Whole turns: gravity circles while the gyro says so, so that tilt and innovation pass +-180 degrees."""
    angle = np.cumsum(np.full(steps, 0.02 + seed * 0.001))
    raw = np.zeros((steps, 6))
    raw[:, 0] = 1675.0 + 60.0 * np.sin(angle / 50.0)
    raw[:, 1], raw[:, 2] = 2048.0 + 992.0 * np.sin(angle), 2048.0 + 992.0 * np.cos(angle)
    noise = _counts(seed, steps) % 7 - 3
    return np.rint(raw).astype(np.int64) + noise * (raw != 0), _held(_angles(seed, steps), seed, 100)


WILD: dict[str, Callable[[int, int], tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]] = {
    "uniform": _uniform,
    "extremes": _extremes,
    "steps": _steps,
    "walk": _walk,
    "spin": _spin,
}


@dataclass(frozen=True)
class Entry:
    """One [[vector]] of the recipe."""

    name: str
    system: str
    tuning: str
    steps: int
    seed: int
    scenario: str | None = None
    wild: str | None = None
    on_link: bool = False
    set: dict[str, Any] = field(default_factory=dict)

    def inputs(self) -> tuple[ControlParams, RawCounts, Setpoints]:
        """Parameters, raw counts (steps, 6) and setpoints (steps,)."""
        system = systems.load(self.system)
        if self.tuning not in system.TUNINGS:
            raise UsageError(f"the recipe's {self.name} asks for the tuning '{self.tuning}', which is not shipped")
        tuning = system.TUNINGS[self.tuning]
        for path, value in self.set.items():
            tuning = _changed(tuning, path.split("."), value)
        if self.wild:
            raw, setpoint = WILD[self.wild](self.seed, self.steps)
        else:
            run = system.scenario(
                self.scenario, self.seed, seconds=self.steps * tuning.period_us * 1e-6, period_us=tuning.period_us
            )
            raw, setpoint = run.counts(), run.setpoint()
            tuning = systems.fitted(run, tuning)
        return quantise(tuning), raw.astype(np.int16), setpoint.astype(np.int32)


def _changed(part: Any, path: list[str], value: Any) -> Any:
    """The dataclass with one dotted field changed."""
    inner = _changed(getattr(part, path[0]), path[1:], value) if len(path) > 1 else value
    return dataclasses.replace(part, **{path[0]: inner})


def read(path: Path, only: Sequence[str] | None = None) -> list[Entry]:
    """The entries, only those of the systems `only` when given; raises UsageError for a recipe that is wrong."""
    try:
        entries = [Entry(**table) for table in tomllib.loads(path.read_text())["vector"]]
    except (OSError, KeyError, TypeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"{path} is not a recipe: {error}") from None
    for entry in entries:
        if (entry.wild is None) == (entry.scenario is None) or (entry.wild and entry.wild not in WILD):
            raise UsageError(f"the recipe's {entry.name} needs either a scenario or one of wild = {', '.join(WILD)}")
    chosen = [entry for entry in entries if not only or entry.system in only]
    if not chosen:
        raise UsageError(f"the recipe has no vectors of {', '.join(only or ())}")
    return chosen

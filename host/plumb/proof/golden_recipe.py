"""The recipe of the golden vectors: which inputs, which parameters, how many steps.

A folder of vectors has a recipe.toml, or NAME.recipe.toml of each system, as tests/vectors; a [[vector]] table each:

    name        also the file's name
    system      a system's name
    tuning      a shipped tuning of that system, by name
    set         optional: dotted fields of the tuning to change, for example {"kalman.q_angle_deg2_per_s" = 10.0}
    scenario    a scenario of that system, with `seed`, from the step `begin` on (default 0); or
    wild        a kind of input that no sensor gives, with `seed`: see WILD; or "reach", which moves parameters, too
    words       optional: parameter words of that system as integers, put in after the tuning was quantised
    steps       number of steps
    on_link     optional: also run over a link
    kind        optional: retune, plausibility or refusal in place of step: see plumb.proof.golden_tasks
    reaches     optional: the purpose of the vector, for the reader

A name is lower-case letters, digits and underscores, so that it cannot lead out of the folder. Every field of a recipe
is checked before it is used: a wrong recipe is a UsageError.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.run_fixed import check_inputs
from plumb.contract.scenario import Scenario, fitted
from plumb.errors import UsageError
from plumb.files import toml_text
from plumb.files.input_files import read_text
from plumb.near_names import did_you_mean
from plumb.proof.golden_random import Draw, random_bits
from plumb.proof.golden_reach import moved, reach
from plumb.proof.golden_tasks import task_of
from plumb.spec import declarations
from plumb.spec.system import COUNTS_LEAST, System
from plumb.spec.tuning import AnyTuning
from plumb.systems.tasks import KINDS, Task

T = TypeVar("T")

RECIPE = "recipe.toml"
MAX_STEPS = 1_000_000
"""Most steps of one vector."""
MAX_BYTES = 1 << 20
"""Largest size of the recipe file."""
MAX_SEED = (1 << 32) - 1
_NAME = re.compile(r"[a-z0-9][a-z0-9_]{0,63}")
EXTREME_COUNTS = np.array([-32768, -32767, -4096, -1, 0, 1, 1675, 2047, 2048, 4094, 4095, 4096, 32766, 32767])
EXTREME_ANGLES = np.array([0, 1, -1, 2**29, -(2**29), 2**30, -(2**30), 2**31 - 1, -(2**31), -(2**31) + 1])


def _counts(seed: int, steps: int, inputs: int) -> npt.NDArray[np.int64]:
    return (random_bits(seed, steps * inputs) >> np.uint64(48)).astype(np.int64).reshape(steps, inputs) - 32768


def _angles(seed: int, steps: int) -> npt.NDArray[np.int64]:
    return (random_bits(seed, steps, 1) >> np.uint64(32)).astype(np.int64) - 2**31


def _held(values: npt.NDArray[np.int64], seed: int, longest: int) -> npt.NDArray[np.int64]:
    """The rows, each held for 1 to `longest` steps."""
    lengths = (random_bits(seed, len(values), 2) % np.uint64(longest)).astype(np.int64) + 1
    return np.repeat(values, lengths, axis=0)[: len(values)]


def _uniform(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Uniformly random 16-bit counts and 32-bit setpoints, new in every step."""
    return _counts(seed, steps, inputs), _angles(seed, steps)


def _extremes(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Limits of the formats and of the ADC, and values next to them, held for up to 20 steps."""
    counts = EXTREME_COUNTS[_counts(seed, steps, inputs) % len(EXTREME_COUNTS)]
    angles = EXTREME_ANGLES[_angles(seed, steps) % len(EXTREME_ANGLES)]
    return _held(counts, seed, 20), _held(angles, seed + 1, 50)


def _steps(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """12-bit counts that jump, then stay for up to 200 steps."""
    return _held(_counts(seed, steps, inputs) & 4095, seed, 200), _held(_angles(seed, steps), seed + 1, 300)


def _walk(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """12-bit counts that wander from rail to rail, and a setpoint that rotates through whole turns."""
    wander = np.cumsum(_counts(seed, steps, inputs) % 129 - 64, axis=0) + 2048
    folded = np.abs((wander + 4095) % 8190 - 4095)
    return folded, ((np.cumsum(_angles(seed, steps) // 64) + 2**31) % 2**32) - 2**31


def _spin(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Whole turns: gravity rotates with a matching gyro rate, so that tilt and innovation pass +-180 degrees."""
    angle = np.cumsum(np.full(steps, 0.02 + seed * 0.001))
    raw = np.zeros((steps, inputs))
    raw[:, 0] = 1675.0 + 60.0 * np.sin(angle / 50.0)
    raw[:, 1], raw[:, 2] = 2048.0 + 992.0 * np.sin(angle), 2048.0 + 992.0 * np.cos(angle)
    noise = _counts(seed, steps, inputs) % 7 - 3
    return np.rint(raw).astype(np.int64) + noise * (raw != 0), _held(_angles(seed, steps), seed, 100)


def _poses(seed: int, steps: int, inputs: int = COUNTS_LEAST) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """A body at rest on each of its six sides in turn, for up to 500 steps each and without rotation in between, under
    1, 0.5 or 1.5 g; no sample in the first five steps. Setpoints of 0 and of 2^15 - 1."""
    raw = np.zeros((steps, inputs), np.int64)
    pose = _held(_counts(seed, steps, 1) % 18, seed, 500)[:, 0]
    side, felt = pose % 6, np.array([2048, 1024, 3072])[pose // 6]
    raw[np.arange(steps), 3 + side // 2] = felt * (1 - 2 * (side % 2))
    raw[:5, 0] = -32768
    return raw, _held(_angles(seed, steps) % 2 * 32767, seed + 1, 200)


WILD: dict[str, Callable[..., tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]] = {
    "uniform": _uniform,
    "extremes": _extremes,
    "steps": _steps,
    "walk": _walk,
    "spin": _spin,
    "poses": _poses,
}
REACH = "reach"
"""The kind of input that depends on the parameters, and changes them: plumb.proof.golden_reach."""


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
    begin: int = 0
    on_link: bool = False
    set: dict[str, object] = field(default_factory=dict)
    words: dict[str, int] = field(default_factory=dict)
    reaches: str = ""
    kind: str = "step"

    def params(self) -> ControlParams:
        """The parameters of the vector, without its inputs, for which a scenario may simulate a flight; raises
        UsageError as `inputs`."""
        return self._possible(self._params)

    def inputs(self) -> tuple[ControlParams, RawCounts, Setpoints]:
        """Parameters, raw counts (steps, 6) and setpoints (steps,); raises UsageError for an impossible recipe."""
        return self._possible(self._inputs)

    def _possible(self, make: Callable[[], T]) -> T:
        try:
            return make()
        except (TypeError, ValueError, AttributeError, ArithmeticError, LookupError) as error:
            what = f"{type(error).__name__}: {error}".partition("\n")[0]
            raise UsageError(f"the recipe's {self.name} cannot be made ({what}); correct its entry") from None

    def _settings(self) -> AnyTuning:
        """The tuning with the fields that the recipe sets."""
        system = systems.load(self.system)
        if self.tuning not in system.TUNINGS:
            raise UsageError(f"the recipe's {self.name} asks for the tuning '{self.tuning}', which is not shipped")
        tuning = system.TUNINGS[self.tuning]
        for path, value in self.set.items():
            tuning = _changed(tuning, path.split("."), value)
        return tuning

    def _scenario(self, tuning: AnyTuning) -> Scenario:
        system = systems.load(self.system)
        seconds = (self.begin + self.steps) * tuning.period_us * 1e-6
        name = self.scenario or system.DEFAULT_SCENARIO
        return system.scenario(name, self.seed, seconds=seconds, period_us=tuning.period_us)

    def _params(self) -> ControlParams:
        tuning = self._settings()
        params = self._exact(quantise(tuning))  # refuses impossible parameters before the scenario is drawn
        if self.wild == REACH:
            return moved(params, Draw(self.seed), frozenset(self.words))
        return params if self.wild else self._exact(quantise(fitted(self._scenario(tuning), tuning)))

    def _inputs(self) -> tuple[ControlParams, RawCounts, Setpoints]:
        tuning = self._settings()
        if self.wild == REACH:
            return reach(self._exact(quantise(tuning)), self.seed, self.steps, frozenset(self.words))
        params = self._params()
        if self.wild:
            declared = declarations.system(self.system)
            wild, asked = WILD[self.wild](self.seed, self.steps, declared.inputs)
            return params, _within_limits(declared, wild).astype(np.int16), asked.astype(np.int32)
        run = self._scenario(tuning)
        setpoint = run.setpoint()[self.begin :]
        raw = check_inputs(self.system, run.counts()[self.begin :], setpoint)[0].astype(np.int16)
        return params, raw, setpoint

    def task(self) -> Task | None:
        """The task of a vector of another kind than steps; None for steps."""
        return None if self.kind == "step" else task_of(self.kind, self.seed, *self.inputs())

    def _exact(self, params: ControlParams) -> ControlParams:
        """The parameters with the words that the recipe sets."""
        if not self.words:
            return params
        return ControlParams.of(params.system, {**params.own(), **self.words}, params.context)


def _within_limits(declared: System, raw: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The inputs with commands limited to the ranges that a board accepts, and 0 in unused words."""
    if not declared.step_commands:
        return raw[:, : declared.counts]
    rows = [
        declared.pack_commands(
            {
                command.name: min(max(command.value(row[at : at + command.size]), command.low), command.high)
                for command, at in zip(declared.step_commands, declared.command_places(), strict=True)
            }
        )
        for row in raw.tolist()
    ]
    return np.hstack([raw[:, : declared.counts], np.array(rows, np.int64).reshape(len(raw), -1)])


def _changed(part: Any, path: list[str], value: Any) -> Any:
    """The dataclass with one dotted field changed."""
    inner = _changed(getattr(part, path[0]), path[1:], value) if len(path) > 1 else value
    return dataclasses.replace(part, **{path[0]: inner})


def is_name(text: object) -> bool:
    """True for a valid name of a vector: lower-case letters, digits and underscores, 64 at most."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def files(folder: Path) -> list[Path]:
    """The recipes of a folder of vectors."""
    whole = [folder / RECIPE] if (folder / RECIPE).is_file() else []
    return whole + sorted(folder.glob(f"*.{RECIPE}"))


def read(folder: Path, only: Sequence[str] | None = None) -> list[Entry]:
    """The entries of all recipes of a folder, only those of the systems `only` when given; raises UsageError for a
    recipe that is wrong, and for none."""
    entries = [entry for path in files(folder) or [folder / RECIPE] for entry in read_file(path)]
    names = [entry.name for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"the recipe in {folder} names {', '.join(twice)} twice; give every vector a name of its own")
    chosen = [entry for entry in entries if not only or entry.system in only]
    if not chosen:
        raise UsageError(f"the recipe has no vectors of {', '.join(only or ())}")
    return chosen


def read_file(path: Path) -> list[Entry]:
    """The entries of one recipe; raises UsageError for a wrong recipe."""
    text = read_text(path, MAX_BYTES, "give a folder with the recipe of its golden vectors")
    try:
        tables = toml_text.parse(text).get("vector")
        if not isinstance(tables, list) or not tables:
            raise ValueError("it has no [[vector]]")
        return [_entry(table) for table in tables]
    except ValueError as error:
        raise UsageError(f"{path} is not a recipe: {error}".partition("\n")[0]) from None


def _entry(table: Any) -> Entry:
    """One [[vector]]; raises ValueError that says which field is wrong."""
    if not isinstance(table, dict):
        raise ValueError("a vector is no table")
    name = table.get("name")
    if not is_name(name):
        raise ValueError(f"{str(name)[:80]!r} is no name: write lower-case letters, digits and underscores, 64 at most")
    fields = {one.name: one for one in dataclasses.fields(Entry)}
    for unknown in sorted(set(table) - set(fields)):
        raise ValueError(f"{name} has a field '{unknown}', which no vector has")
    for needed in ("system", "tuning", "steps", "seed"):
        if needed not in table:
            raise ValueError(f"{name} lacks the field '{needed}'")
    for kind, of in (
        (str, ("system", "tuning", "scenario", "wild", "reaches", "kind")),
        (int, ("steps", "seed", "begin")),
        (bool, ("on_link",)),
    ):
        for key in of:
            if key in table and type(table[key]) is not kind:
                raise ValueError(f"{name}: {key} is no {kind.__name__}")
    if table.get("kind", "step") not in ("step", *KINDS) or ("kind" in table and table.get("on_link")):
        raise ValueError(f"{name}: kind is one of step, {', '.join(KINDS)}, and those but step are not for a link")
    if table["system"] not in systems.SYSTEMS:
        meant = did_you_mean(table["system"], systems.SYSTEMS)
        raise ValueError(f"{name}: there is no system '{table['system'][:80]}'{meant}")
    if not 1 <= table["steps"] <= MAX_STEPS or not 0 <= table["seed"] <= MAX_SEED:
        raise ValueError(f"{name}: steps are 1 to {MAX_STEPS}, a seed is 0 to {MAX_SEED}")
    if not 0 <= table.get("begin", 0) <= MAX_STEPS or ("begin" in table and "wild" in table):
        raise ValueError(f"{name}: begin is a step of a scenario, 0 to {MAX_STEPS}")
    if ("scenario" in table) == ("wild" in table) or table.get("wild", REACH) not in (*WILD, REACH):
        raise ValueError(f"{name} needs either a scenario or one of wild = {', '.join((*WILD, REACH))}")
    changes = table.get("set", {})
    if not isinstance(changes, dict) or not all(map(_is_scalar, changes.values())):
        raise ValueError(f"{name}: set is a table of dotted fields and finite numbers")
    words = table.get("words", {})
    if not isinstance(words, dict) or any(type(value) is not int or abs(value) >= 1 << 32 for value in words.values()):
        raise ValueError(f"{name}: words is a table of parameters and integers of 32 bits")
    return Entry(**table)


def _is_scalar(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, (bool, str)) or (isinstance(value, int) and abs(value) < 1 << 63)

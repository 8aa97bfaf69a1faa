"""A study: which runs a campaign makes. Declared in a TOML file, or by the name of a system and options.

    system = "NAME"
    runs = 4000                     # in all
    first_seed = 1000
    seconds = 60
    open_loop = true
    invariants = true               # judge every run by the invariants of the system (scenario "random")
    draw = "latin-hypercube"        # or "grid", "random"
    [conditions]
    bandwidth_hz = 50
    [vary]
    scenario = ["motion", "quiet"]
    "condition.delay_ms" = { low = 0, high = 10 }
    "tuning.trust.r_deg2" = { low = 0.05, high = 5, log = true }

On a grid, run i has point i modulo the number of points, and the seed first_seed + i // points: every point sees the
same seeds. Otherwise run i has the seed first_seed + i.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shlex
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plumb import systems
from plumb.campaign import recorded
from plumb.campaign.factors import DRAWS, GRID, Factor, Value, factor_of, is_number, points_of, values_of
from plumb.campaign.recorded import RecordedRequest
from plumb.campaign.settings import tuning_with
from plumb.contract.scenario import tuning_for
from plumb.errors import UsageError
from plumb.files.input_files import check_regular
from plumb.link.endpoint_names import parse_board
from plumb.near_names import did_you_mean
from plumb.proof import invariants, scenario_run
from plumb.proof.scenario_run import RunRequest

RUNS, RUNS_MOST = 400, 10_000_000
SEED_MOST = 10**18
"""No seed of a campaign is larger: it is a column of 64 bits."""
RECORDED = ("recording", "grade")
"""Factors of a study on recordings."""
CHOSEN = ("scenario", "tuning", "start", "faults", *RECORDED)
"""Factors whose choices are names, and which may decide which figures a run has; others are `condition.NAME` and
`tuning.PATH`."""
CONDITION, SETTING = "condition.", "tuning."
VIRTUAL = "virtual"
"""The board that has a link and an image."""


@dataclass(frozen=True)
class Study:
    """runs: in all. reference: every run is compared with the float64 reference, too. confirm: a board that runs every
    step once more; None: none does."""

    system: str
    runs: int = RUNS
    first_seed: int = 1000
    seconds: float | None = None
    open_loop: bool = False
    scenario: str | None = None
    tuning: str | None = None
    start: str | None = None
    faults: tuple[str, ...] = ()
    conditions: Mapping[str, float] = field(default_factory=dict)
    draw: str = GRID
    draw_seed: int = 1
    vary: tuple[Factor, ...] = ()
    recording: str | None = None
    """Name of a recording that every run has, instead of a scenario; or a factor has it."""
    recordings: str | None = None
    """The folder of the recordings, seen from that of the study's file; None: that of PLUMB_DATA."""
    grade: str | None = None
    """Errors of the sensors on a recording, as `plumb compare --grade` has them."""
    decimate: int = 1
    """Samples of a recording in a block, whose mean is taken first."""
    as_found: bool = False
    """What an audit is sure of is undone in each recording, as `plumb replay --as-found` does it."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Metric -> the most that a run may have; the share of the runs that keep it is reported."""
    reference: bool = False
    invariants: bool = False
    """Every run is judged by the invariants of its system (plumb.proof.invariants)."""
    confirm: str | None = None
    link: str = "serial"
    """serial or can, of `virtual`."""
    image: str | None = None
    """Flash image of `virtual`: a file, or the name of one in the package; None: the checkout's build."""
    path: str | None = None
    """The file that it was read from."""

    def to_json(self) -> dict[str, Any]:  # Any: TOML
        """Everything that decides what the runs are, and the limits."""
        plain = {one.name: getattr(self, one.name) for one in dataclasses.fields(self)}
        del plain["path"]
        vary = {factor.name: factor.to_json() for factor in self.vary}
        return {
            **plain,
            "faults": list(self.faults),
            "conditions": dict(self.conditions),
            "vary": vary,
            "limits": dict(self.limits),
        }

    def sha256(self) -> str:
        """SHA-256 of the entries that decide the runs: a limit may change when they are done."""
        deciding = {name: value for name, value in self.to_json().items() if name != "limits"}
        return hashlib.sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()

    def seed(self, index: int) -> int:
        return self.first_seed + (index // points_of(self.vary) if self.draw == GRID else index)

    def values(self, index: int) -> dict[str, Value]:
        """The values of the factors in run `index`."""
        return values_of(self.vary, self.draw, self.draw_seed, self.runs, index)

    def request(self, index: int) -> RunRequest:
        """Run `index`, as `plumb run` would be asked for it."""
        values = self.values(index)
        conditions = dict(self.conditions)
        settings = self._settings(values)
        chosen: dict[str, Any] = {"scenario": self.scenario, "tuning": self.tuning, "start": self.start}  # Any: TOML
        faults: list[str] = list(self.faults)
        for name, value in values.items():
            if name == "faults":
                faults = [*faults, *((value,) if isinstance(value, str) else _texts(value))]
            elif name.startswith(CONDITION):
                conditions[name.removeprefix(CONDITION)] = _number(name, value)
            elif name in chosen:
                chosen[name] = value
        if settings:
            chosen["tuning"] = tuning_with(self.system, chosen["scenario"], chosen["tuning"], settings)
        return RunRequest(
            system=self.system,
            board="native",
            **chosen,
            seed=self.seed(index),
            seconds=self.seconds,
            faults=faults,
            conditions=[f"{name}={number!r}" for name, number in conditions.items()],
            open_loop=self.open_loop,
        )

    @property
    def recordings_named(self) -> list[str]:
        """The recordings on which runs are; [] for a study of scenarios."""
        chosen = [one for factor in self.vary if factor.name == "recording" for one in factor.choices]
        return [str(one) for one in chosen] or ([self.recording] if self.recording else [])

    def recording_files(self) -> list[Path]:
        """Their files. Raises UsageError where there is no folder."""
        named = self.recordings_named
        return [recorded.folder(self.recordings, self.path) / name for name in named] if named else []

    def replay(self, index: int) -> RecordedRequest | None:
        """Run `index` on a recording; None for a study of scenarios."""
        if not self.recordings_named:
            return None
        values = self.values(index)
        name, settings = values.get("tuning", self.tuning), self._settings(values)
        tuning = tuning_with(self.system, None, str(name), settings) if name is not None else None
        grade = values.get("grade", self.grade)
        return RecordedRequest(
            self.system,
            recorded.folder(self.recordings, self.path) / str(values.get("recording", self.recording)),
            self.seed(index),
            None if grade is None else str(grade),
            self.seconds,
            self.decimate,
            tuning,
            self.as_found,
        )

    def _settings(self, values: Mapping[str, Value]) -> dict[str, float | str]:
        """Paths in the tuning -> numbers or names, of what is varied."""
        return {
            name.removeprefix(SETTING): value if isinstance(value, str) else _number(name, value)
            for name, value in values.items()
            if name.startswith(SETTING)
        }

    def described(self) -> str:
        """The scenario and the factors, for the head of a page."""
        names = {factor.name for factor in self.vary}
        if self.recordings_named:
            said = [] if "recording" in names else [f"recording {self.recording}"]
        else:
            known = systems.load(self.system)
            scenario = self.scenario or known.DEFAULT_SCENARIO
            said = [] if "scenario" in names else [f"scenario {scenario}"]
            # the tuning of a scenario that varies is that scenario's own
            named = self.tuning or ("" if "scenario" in names else tuning_for(known, scenario))
            said += [f"tuning {named}"] if named and "tuning" not in names else []
            said += [f"{'open' if self.open_loop or not known.OUTPUTS else 'closed'} loop"]
        said += [f"{self.seconds:g} s"] if self.seconds is not None else []
        said += [f"{name} {number:g}" for name, number in self.conditions.items()] + list(self.faults)
        return ", ".join(said + ([f"varied: {', '.join(factor.name for factor in self.vary)}"] if self.vary else []))

    @property
    def conditions_varied(self) -> frozenset[str]:
        """Names of the conditions that differ from run to run."""
        names = (factor.name for factor in self.vary)
        return frozenset(name.removeprefix(CONDITION) for name in names if name.startswith(CONDITION))

    def confirming_command(self, index: int) -> str:
        """The command line that repeats run `index` on the board that confirms."""
        board = [self.confirm or "", *(["--link", self.link] if self.link != "serial" else [])]
        board += ["--image", self.image] if self.image is not None else []
        before, native, after = self.command(index).partition("--board native")
        return f"{before}--board {shlex.join(board)}{after}" if native else f"{before} --confirm {shlex.join(board)}"

    def command(self, index: int, smaller: RunRequest | None = None) -> str:
        """The command line that repeats run `index`. smaller: the same run with other conditions, but for those that
        the study varies, and another length."""
        replay = self.replay(index)
        if replay is not None and (known := replay.command()) is not None:
            return known
        if replay is not None:
            words = ["plumb", "campaign", self.path or "STUDY.toml", "--only", str(index), "--runs", str(self.runs)]
            words += ["--first-seed", str(self.first_seed), *(["--tuning", self.tuning] if self.tuning else [])]
            words += ["--as-found"] if self.as_found else []
            return shlex.join([*words, *(["--seconds", f"{self.seconds:g}"] if self.seconds is not None else [])])
        repeated = any(factor.name.startswith(SETTING) for factor in self.vary)
        asked = smaller or self.request(index)
        scenario, tuning, conditions, faults = asked.scenario, asked.tuning, asked.conditions, asked.faults
        words = ["plumb", "run", self.system, "--board", "native", "--seed", str(asked.seed)]
        if repeated:  # no other command has the settings of a tuning
            words = ["plumb", "campaign", self.path or "STUDY.toml", "--only", str(index), "--runs", str(self.runs)]
            words += ["--first-seed", str(self.first_seed)]
            scenario, tuning, faults = self.scenario, self.tuning, list(self.faults)
            varied = self.conditions_varied
            conditions = [text for text in conditions if text.partition("=")[0] not in varied]
        for option, value in (("--scenario", scenario), ("--tuning", tuning), ("--start", asked.start)):
            words += [option, str(value)] if value and not (repeated and option == "--start") else []
        words += ["--seconds", f"{asked.seconds:g}"] if asked.seconds is not None else []
        words += [word for text in conditions for word in ("--condition", text)]
        words += [word for text in faults for word in ("--fault", text)]
        return shlex.join([*words, *(["--open-loop"] if self.open_loop else [])])


def _texts(value: Value) -> tuple[str, ...]:
    if not isinstance(value, tuple):
        raise UsageError(f"vary.faults has the choice {value!r}: give lists of faults as texts")
    return value


def _number(name: str, value: Value) -> float:
    if not isinstance(value, float):
        raise UsageError(f"vary.{name} has the choice {value!r}: give numbers")
    return value


KEYS: dict[str, type] = {
    "system": str, "runs": int, "first_seed": int, "seconds": float, "open_loop": bool, "scenario": str, "tuning": str,
    "start": str, "faults": list, "conditions": dict, "draw": str, "draw_seed": int, "vary": dict, "limits": dict,
    "reference": bool, "confirm": str, "link": str, "image": str, "recording": str, "recordings": str, "grade": str,
    "decimate": int, "invariants": bool, "as_found": bool,
}  # fmt: skip
"""Entries of a study and their kinds."""
KINDS: dict[type, str] = {
    str: "a text", int: "a whole number", float: "a number", bool: "true or false", list: "a list", dict: "a table",
}  # fmt: skip


def read(path: Path) -> Study:
    """The study of a TOML file; raises UsageError for a file that is not one."""
    check_regular(path, "give a study as a TOML file, or the name of a system")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))  # some editors begin a file with a mark
    except RecursionError:
        raise UsageError(f"{path} is no study: its lists or tables are nested too deeply") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} is no study: {error}") from None
    return from_table(table, str(path))


def from_table(table: Mapping[str, Any], path: str | None = None) -> Study:  # Any: TOML
    """A study from its entries; checks what can be wrong before the first run. Raises UsageError."""
    try:
        study = _built(table, path)
        check(study)
    except UsageError as error:
        raise UsageError(f"{path}: {error}" if path else str(error)) from None
    return study


def _built(table: Mapping[str, Any], path: str | None) -> Study:  # Any: TOML
    for name, value in table.items():
        if name not in KEYS:
            near = did_you_mean(name, list(KEYS))
            raise UsageError(f"a study has no entry '{name}'{near}; it has {', '.join(KEYS)}")
        kind = KEYS[name]
        wanted = (int, float) if kind is float else kind
        if not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool):
            raise UsageError(f"{name} = {value!r}: it is {KINDS[kind]}")
        if kind is float and not is_number(value):
            raise UsageError(f"{name} is no finite number")
    if "system" not in table:
        raise UsageError('a study names its system: system = "NAME"')
    if table.get("link", "serial") not in ("serial", "can"):
        raise UsageError(f"link = {table['link']!r}: it is serial or can")
    given = dict(table)
    given["vary"] = tuple(factor_of(name, value) for name, value in _flat(given.get("vary", {})).items())
    given["faults"] = tuple(given.get("faults", ()))
    if not all(isinstance(fault, str) for fault in given["faults"]):
        raise UsageError(f"faults = {list(given['faults'])!r}: it is a list of texts")
    for entry in ("conditions", "limits"):
        given[entry] = {name: _real(f"{entry}.{name}", value) for name, value in given.get(entry, {}).items()}
    return Study(**given, path=path)


def _real(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"{name} = {value!r}: it is a number")
    if not is_number(value):
        raise UsageError(f"{name} is no finite number")
    return float(value)


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:  # Any: TOML
    """Tables in tables as names with dots; a range is a table, too."""
    found: dict[str, Any] = {}  # Any: TOML
    for name, value in table.items():
        inner = isinstance(value, Mapping) and not {"low", "high"} & set(value)
        found |= _flat(value, f"{before}{name}.") if inner else {before + name: value}
    return found


def check(study: Study) -> None:
    """Raises UsageError for what is wrong in a study, whatever its seeds."""
    systems.load(study.system)
    if not 1 <= study.runs <= RUNS_MOST:
        raise UsageError(f"runs = {study.runs}: a campaign has 1 to {RUNS_MOST} runs")
    if not (0 <= study.first_seed <= SEED_MOST - study.runs and 0 <= study.draw_seed <= SEED_MOST):
        raise UsageError(f"a seed is 0 to {SEED_MOST}, that of the last run, too")
    if study.draw not in DRAWS:
        raise UsageError(f"draw = '{study.draw}'; there are {', '.join(DRAWS)}")
    if study.seconds is not None and not 1.0 <= study.seconds <= 3600.0:
        raise UsageError(f"seconds = {study.seconds:g}: a run takes 1 to 3600 s")
    if study.confirm is not None:
        parse_board(study.confirm)
    if study.confirm != VIRTUAL and (study.link != "serial" or study.image is not None):
        raise UsageError(f"{'link' if study.image is None else 'image'} is for confirm = '{VIRTUAL}'")
    for factor in study.vary:
        if factor.name not in CHOSEN and not factor.name.startswith((CONDITION, SETTING)):
            known = ", ".join((*CHOSEN, f"{CONDITION}NAME", f"{SETTING}PATH"))
            raise UsageError(f"'{factor.name}' cannot be varied; {known} can")
        named = factor.name in CHOSEN and factor.name != "faults"
        if named and not all(isinstance(one, str) for one in factor.choices):
            raise UsageError(f"vary.{factor.name}: give a list of names")
        if factor.name in CHOSEN and not factor.choices:
            raise UsageError(f"vary.{factor.name}: give a list of choices")
        if _is_set(study, factor.name):
            raise UsageError(f"{factor.name} is set, and varied by vary.{factor.name}: leave one of them out")
    _check_recorded(study)
    points = points_of(study.vary) if study.draw == GRID else 1
    for index in range(min(study.runs, max(points, 1), 1000)):
        replay = study.replay(index)
        if replay is None:
            scenario_run.check(study.request(index))
        else:
            recorded.check(replay)
    if study.invariants:
        varied = [str(one) for factor in study.vary if factor.name == "scenario" for one in factor.choices]
        invariants.require(study.system, varied or [study.scenario])


def _is_set(study: Study, factor: str) -> bool:
    """Whether the study gives one value to what the factor varies. Faults of both are added."""
    if factor.startswith(CONDITION):
        return factor.removeprefix(CONDITION) in study.conditions
    return factor in CHOSEN and factor != "faults" and getattr(study, factor) is not None


def _check_recorded(study: Study) -> None:
    """Raises UsageError for entries that belong to a recording without one, and the other way round."""
    varied = {factor.name for factor in study.vary}
    if not study.recordings_named:
        alone = [name for name in ("recordings", "grade") if getattr(study, name) is not None or name in varied]
        alone += ["decimate"] if study.decimate != 1 else []
        alone += ["as_found"] if study.as_found else []
        if alone:
            raise UsageError(f"{alone[0]} is for recordings: name one with recording, or several with vary.recording")
        return
    given = [name for name in ("scenario", "start", "faults", "conditions", "invariants") if getattr(study, name)]
    given += sorted(name for name in varied if name in ("scenario", "start", "faults") or name.startswith(CONDITION))
    if given:
        raise UsageError(f"{given[0]} is for scenarios: a recording has none")
    if study.tuning is None and "tuning" not in varied and any(name.startswith(SETTING) for name in varied):
        raise UsageError("settings of a tuning are varied: name the tuning, with tuning = 'NAME'")

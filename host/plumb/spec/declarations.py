"""Declarations of the systems: number, record, channels, parameters, frames, flags, output.

A system is a folder NAME with a file `system.toml`, either in this package or in one of the folders that the
environment variable PLUMB_SYSTEM_PATH lists. Everything that depends on the set of systems is derived from the
declarations: in Python at run time, in C by `tools/generate.py`.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from plumb.checkout import PACKAGE
from plumb.errors import UsageError
from plumb.spec.base_units import BASE_UNITS, unknown_part

TomlTable = Mapping[str, Any]  # Any: values as TOML gives them; they are checked when the declaration is loaded
"""A table of a declaration."""

SHIPPED = PACKAGE / "systems"
BLOCKS_PATH = Path(__file__).with_name("blocks.toml")
SHARED_PATH = Path(__file__).with_name("parameters.toml")
SEARCH_PATH = "PLUMB_SYSTEM_PATH"
"""Environment variable with further folders that hold folders of systems, separated as in PATH."""

RAW_CHANNELS = 6
"""Number of raw counts in every record; a system uses the first ones, one for each of its channels."""
NUMBERS = range(18)
"""Numbers that a system may have. The number is the high byte of its signal numbers and selects its block of CAN
identifiers."""
WORDS_MAX = 255
"""Most 32-bit words in a record: a word's place is the low byte of its signal number."""
FRAMES_MAX = 12
"""Most frames of one system: each needs an entry in the frame counters of a link."""
TYPES = {"int32": "<i4", "uint32": "<u4", "int64": "<i8"}
"""Type of a declared word -> numpy type."""
SENSORS = ("NONE", "ANALOG_3", "ANALOG_6", "BALANCE", "SIX_AXES")
"""Sensor sets that a board can sample (CONTROL_SENSORS_ in firmware/systems/control.h)."""
OUTPUTS = {"PULSES": 2, "BRIDGE": 1}
"""Kind of actuator (CONTROL_OUTPUT_) -> number of record words that drive it."""


@dataclass(frozen=True)
class Word:
    """One word of a record. member: its path in the C struct of the record; format: what the integer stands for."""

    name: str
    type: str
    unit: str
    format: str
    doc: str
    member: str

    @property
    def size(self) -> int:
        """Bytes."""
        return 8 if self.type == "int64" else 4


@dataclass(frozen=True)
class Member:
    """One member of the record's C struct. count: 0 for a single value, else the length of the array."""

    struct: str
    name: str
    count: int
    doc: str


@dataclass(frozen=True)
class Flag:
    """One bit of the word `flags`. saturated: a raw count was outside its range."""

    name: str
    saturated: bool
    doc: str


@dataclass(frozen=True)
class Part:
    """The part of a word that a frame carries. shift: number of low bits dropped; a 16-bit part saturates."""

    name: str
    word: Word
    shift: int


@dataclass(frozen=True)
class Frame:
    """One frame of telemetry: a 16-bit part (`half`, optional) and a 32-bit part (`word`)."""

    name: str
    half: Part | None
    word: Part
    doc: str


@dataclass(frozen=True)
class Channel:
    """One raw count of a sample, in the order of the sample.

    calibration: parameter group that converts the count to its quantity; "" if there is none.
    axis: the component of the body's motion that the calibrated value measures: `gyr_x`, `acc_y`, `ang_z` (angular
    rate, specific force, angular acceleration), with `-` for the negative; "" if it measures none.
    """

    name: str
    unit: str
    doc: str
    calibration: str = ""
    axis: str = ""


@dataclass(frozen=True)
class System:
    """One declared system.

    words: all words of its record; members: the C struct members between setpoint and flags.
    cycles: cycle budget of a step, cycles_mean of the mean step where work is spread over steps; None without a budget.
    missing_samples: `held` (the last sample is used again) or
    `marked` (every count is -32768). output: "" without an actuator, else a key of OUTPUTS; output_words drive it.
    period: the parameter that holds the period of a step in s.
    groups: shared parameter groups that the step reads; parameters: rows of the system's own groups; all_groups: both.
    structs: group -> C struct of the kernel that reads it; includes: headers of those structs.
    commands: the system's own commands, name -> one sentence; their modules are in its folder `commands`.
    default_for: parts (`replay`, `demo`) for which this system is the default of the command.
    """

    name: str
    number: int
    title: str
    folder: Path
    cycles: int | None
    cycles_mean: int | None
    optimise: str
    channels: tuple[Channel, ...]
    sensors: str
    missing_samples: str
    words: tuple[Word, ...]
    members: tuple[Member, ...]
    flags: tuple[Flag, ...]
    frames: tuple[Frame, ...]
    output: str
    output_words: tuple[Word, ...]
    period: str
    groups: tuple[str, ...]
    parameters: tuple[TomlTable, ...]
    structs: Mapping[str, str]
    includes: tuple[str, ...]
    commands: Mapping[str, str]
    default_for: tuple[str, ...]

    @property
    def shipped(self) -> bool:
        """True for a system of this package, False for one on PLUMB_SYSTEM_PATH."""
        return self.folder.parent == SHIPPED

    @property
    def all_groups(self) -> tuple[str, ...]:
        """The parameter groups that the step reads: shared groups, then the system's own."""
        own = dict.fromkeys(group_of(row["name"]) for row in self.parameters)
        return (*self.groups, *own)

    @property
    def record_bytes(self) -> int:
        return sum(word.size for word in self.words)

    def word(self, name: str) -> Word:
        """The word of that name; raises UsageError if the record has none."""
        for word in self.words:
            if word.name == name:
                return word
        raise UsageError(f"{self.name}: the record has no word '{name}'")

    def place(self, name: str) -> int:
        """Position of a word in the record, in units of four bytes; raises UsageError if the record has no such
        word."""
        at = 0
        for word in self.words:
            if word.name == name:
                return at // 4
            at += word.size
        raise UsageError(f"{self.name}: the record has no word '{name}'")

    def signals(self) -> dict[int, str]:
        """Signal number (system << 8 | position in the record) -> name. A 64-bit word has two, low half first."""
        names: dict[int, str] = {}
        for word in self.words:
            for half in ("_lo", "_hi") if word.size == 8 else ("",):
                names[self.number << 8 | len(names)] = word.name + half
        return names


def search_path() -> list[Path]:
    """The folders on PLUMB_SYSTEM_PATH; raises UsageError for one that does not exist."""
    places = [Path(place).resolve() for place in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if place]
    for place in places:
        if not place.is_dir():
            raise UsageError(f"{SEARCH_PATH}: there is no folder {place}")
    return places


def folders() -> list[Path]:
    """The folders of all systems: those of the package, then those on the search path."""
    return [path.parent for place in (SHIPPED, *search_path()) for path in sorted(place.glob("*/system.toml"))]


@lru_cache(maxsize=4)
def _loaded(search_path: str) -> dict[str, System]:
    found: dict[str, System] = {}
    for system in sorted((load_system(folder) for folder in folders()), key=lambda system: system.number):
        if system.name in found:
            raise UsageError(f"two systems are named {system.name}: {found[system.name].folder} and {system.folder}")
        taken = [other.name for other in found.values() if other.number == system.number]
        if taken:
            raise UsageError(f"{system.folder / 'system.toml'}: number {system.number} is that of {taken[0]}")
        for other in found.values():
            for part in set(system.default_for) & set(other.default_for):
                raise UsageError(f"{system.folder / 'system.toml'}: default_for: {other.name} is that of {part}")
        found[system.name] = system
    if not found:
        raise UsageError(f"there is no system in {SHIPPED} nor on {SEARCH_PATH}")
    return found


def systems() -> dict[str, System]:
    """Name -> declaration, in the order of their numbers."""
    return _loaded(os.environ.get(SEARCH_PATH, ""))


def names() -> tuple[str, ...]:
    """Names of all systems, in the order of their numbers."""
    return tuple(systems())


def system(name: str) -> System:
    """The declaration of a system; raises UsageError for an unknown name."""
    declared = systems().get(name)
    if declared is None:
        raise UsageError(f"there is no system '{name}'; this version has {', '.join(systems())}")
    return declared


def name_of(number: int) -> str:
    """Name of the system with that number; raises UsageError if no system has it."""
    for declared in systems().values():
        if declared.number == number:
            return declared.name
    known = ", ".join(f"{declared.number} {declared.name}" for declared in systems().values())
    raise UsageError(f"there is no system {number}; this version has {known}")


@lru_cache(maxsize=1)
def blocks() -> dict[str, TomlTable]:
    """Kernel -> its state struct in C: `struct`, `header`, `words` (blocks.toml)."""
    return tomllib.loads(BLOCKS_PATH.read_text(encoding="utf-8"))


@lru_cache(maxsize=1)
def shared() -> TomlTable:
    """`parameters.toml`: `structs` of the shared groups, with the headers they need in `includes`, and the rows."""
    return tomllib.loads(SHARED_PATH.read_text(encoding="utf-8"))


def group_of(parameter: str) -> str:
    """The group of a parameter, from its name: `kalman` of kalman.qb; "" for a parameter without a group."""
    return parameter.rpartition(".")[0]


def load_system(folder: Path) -> System:
    """Read and check one declaration; raises UsageError with a sentence that names the file."""
    path = folder / "system.toml"
    try:
        return _system(folder, tomllib.loads(path.read_text(encoding="utf-8")))
    except KeyError as error:
        raise UsageError(f"{path}: {error.args[0]} is missing") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except RecursionError:
        raise UsageError(f"{path}: brackets are nested too deep") from None
    except (AttributeError, IndexError, tomllib.TOMLDecodeError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: {error}") from None
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _system(folder: Path, table: TomlTable) -> System:
    if not re.fullmatch(r"[a-z][a-z0-9]*", folder.name):
        raise UsageError("the folder's name is that of the system: small letters and digits")
    setpoint = Word(type="int32", member=table["setpoint"]["name"], **table["setpoint"])
    middle, members = _record(table["record"])
    raw = (Word(f"raw_{i}", "int32", "count", "integer", "count as given", f"raw[{i}]") for i in range(RAW_CHANNELS))
    flags = Word("flags", "uint32", "", "bits", "of this step", "flags")
    step = Word("step", "uint32", "step", "integer", "number of this step in the run, from 1", "step")
    words = (*raw, setpoint, *middle, flags, step)
    by_name = {word.name: word for word in words}
    output = table.get("output", {"kind": ""})
    if not isinstance(table["groups"], list):
        raise UsageError(f"groups is a list of names, not {table['groups']!r:.40}")
    structs = dict(table.get("structs", {}))
    declared = System(
        name=folder.name,
        number=table["number"],
        title=table["title"],
        folder=folder,
        cycles=table.get("cycles"),
        cycles_mean=table.get("cycles_mean"),
        optimise=table.get("optimise", "speed"),
        channels=tuple(Channel(**channel) for channel in table["channels"]),
        sensors=table["sensors"],
        missing_samples=table.get("missing_samples", "held"),
        words=words,
        members=tuple(members),
        flags=tuple(Flag(flag["name"], flag.get("saturated", False), flag["doc"]) for flag in table["flags"]),
        frames=tuple(_frame(frame, by_name) for frame in table["frames"]),
        output=output["kind"],
        output_words=_output_words(output, words),
        period=table["period"],
        groups=tuple(table["groups"]),
        parameters=tuple({"owner": "control", **row} for row in table.get("parameter", ())),
        includes=tuple(structs.pop("includes", ())),
        structs=structs,
        commands=dict(table.get("commands", {})),
        default_for=tuple(table.get("default_for", ())),
    )
    _check(declared)
    return declared


def _record(entries: Iterable[TomlTable]) -> tuple[list[Word], list[Member]]:
    """The words between setpoint and flags, and the members of the C struct that hold them."""
    words: list[Word] = []
    members: list[Member] = []
    for entry in entries:
        if not isinstance(entry, Mapping):
            raise UsageError(f"record: {entry!r:.40} is no table with a name")
        count, name = entry.get("count", 0), entry["name"]
        if type(count) is not int or not 0 <= count <= WORDS_MAX:
            raise UsageError(f"record: count of {name} is an integer from 1 to {WORDS_MAX}, not {count!r:.40}")
        if "names" in entry and len(entry["names"]) != count:
            raise UsageError(f"record: {name} has {len(entry['names'])} names for {count} words")
        if entry.get("block", "kalman") not in blocks():
            raise UsageError(f"record: there is no block '{entry['block']}'; there are {', '.join(blocks())}")
        block = blocks()[entry["block"]] if "block" in entry else None
        members.append(Member(block["struct"] if block else entry["type"] + "_t", name, count, entry.get("doc", "")))
        for index in range(count) if count else (None,):
            at = name if index is None else f"{name}[{index}]"
            if block is None:
                given = entry["names"][index] if "names" in entry else _indexed(name, index)
                words.append(Word(given, entry["type"], entry["unit"], entry["format"], entry["doc"], at))
                continue
            rename = entry.get("rename", {})
            for word in block["words"]:
                stem = rename.get(word["name"]) or entry.get("prefix", "") + word["name"]
                member = f"{at}.{word.get('member', word['name'])}"
                for i in range(word["count"]) if "count" in word else (None,):
                    place = member if i is None else f"{member}[{i}]"
                    given = _indexed(_indexed(stem, i), index)
                    words.append(Word(given, word["type"], word["unit"], word["format"], word["doc"], place))
    return words, members


def _indexed(name: str, index: int | None) -> str:
    return name if index is None else f"{name}_{index}"


def _frame(frame: TomlTable, words: Mapping[str, Word]) -> Frame:
    def part(given: TomlTable) -> Part:
        if given["of"] not in words:
            raise UsageError(f"frame {frame['name']}: the record has no word '{given['of']}'")
        return Part(given["name"], words[given["of"]], given.get("shift", 0))

    return Frame(frame["name"], part(frame["half"]) if "half" in frame else None, part(frame["word"]), frame["doc"])


def _output_words(output: TomlTable, words: tuple[Word, ...]) -> tuple[Word, ...]:
    if not output["kind"]:
        return ()
    if output["kind"] not in OUTPUTS:
        raise UsageError(f"output.kind is one of {', '.join(OUTPUTS)}, not {output['kind']}")
    names = [word.name for word in words]
    if output["word"] not in names:
        raise UsageError(f"output: the record has no word '{output['word']}'")
    first = names.index(output["word"])
    return words[first : min(first + OUTPUTS[output["kind"]], len(words) - 2)]  # flags and step drive nothing


C_KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if inline int long "
        "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while",
    )
)
_LOWER, _UPPER = re.compile(r"[a-z][a-z0-9_]*"), re.compile(r"[A-Z][A-Z0-9_]*")
_COMMAND = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_PARAMETER = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)+")
_FORMAT = re.compile(r"Q\d\d?|Q\([^)]*\)|integer|bits|choice|see \w+")
_AXIS = re.compile(r"-?(gyr|acc|ang)_[xyz]")
CALIBRATION_ROWS = ("raw_min", "raw_max", "gain", "offset")
"""The rows of a group that calibrates a raw channel."""
_ROW: dict[str, type] = {
    **dict.fromkeys(("name", "owner", "type", "unit", "format", "doc"), str),
    **dict.fromkeys(("min", "max", "default"), int),
}


def _check_text(what: str, value: object, pattern: re.Pattern[str] | None = None) -> None:
    """Raises UsageError unless the value is a line of text that fits into C comments and the DBC, and, with a pattern,
    a name that matches it."""
    if not isinstance(value, str) or not value.isprintable() or "*/" in value or '"' in value:
        raise UsageError(f"{what} is a line of text without quotes or */, not {value!r:.40}")
    if pattern is not None and (not pattern.fullmatch(value) or value in C_KEYWORDS):
        raise UsageError(f"{what}: {value!r:.40} cannot be a name in C and in the DBC: letters, digits and _")


def _check_units(system: System) -> None:
    """Raises UsageError for a unit with a part that is neither a base unit nor one of the system's quantities."""
    own = [word.name for word in system.words]
    own += [row["name"].rpartition(".")[2] for row in system.parameters]
    stated = [(f"word {word.name}", word.unit) for word in system.words]
    stated += [(f"channel {channel.name}", channel.unit) for channel in system.channels]
    stated += [(f"parameter {row['name']}", row["unit"]) for row in system.parameters]
    for what, unit in stated:
        part = unknown_part(unit, own)
        if part:
            raise UsageError(f"{what}: unit '{unit:.40}' has '{part:.40}'; units are {' '.join(sorted(BASE_UNITS))}")


def _check_groups(system: System) -> None:
    """Raises UsageError for an unknown shared group, and for a channel whose axis or calibration is wrong."""
    rows = [*shared()["parameter"], *system.parameters]
    known = list(dict.fromkeys(group_of(row["name"]) for row in shared()["parameter"] if row["owner"] == "control"))
    for group in system.groups:
        if group not in known:
            raise UsageError(f"groups: there is no shared group {group!r:.40}; there are {', '.join(known)}")
    for channel in system.channels:
        if channel.axis and not (channel.calibration and _AXIS.fullmatch(str(channel.axis))):
            raise UsageError(
                f"channel {channel.name}: axis = {channel.axis!r:.40}: write gyr, acc or ang with _x, _y or _z, as in "
                "gyr_x or -acc_y, and give the channel a calibration"
            )
        if not channel.calibration:
            continue
        what = f"channel {channel.name}: calibration = {channel.calibration!r:.40}"
        if channel.calibration not in system.all_groups:
            raise UsageError(f"{what}: it is one of the groups that the step reads, {', '.join(system.all_groups)}")
        lacking = {f"{channel.calibration}.{row}" for row in CALIBRATION_ROWS} - {row["name"] for row in rows}
        if lacking:
            raise UsageError(f"{what}: a calibration has the rows {', '.join(CALIBRATION_ROWS)}")


def _check_names(system: System) -> None:
    """Raises UsageError for a text or a name that generated C or the DBC cannot hold."""
    _check_text("title", system.title)
    for word in system.words:
        _check_text("a word of the record", word.name, _LOWER)
        _check_text(f"{word.name}: doc", word.doc)
        _check_text(f"{word.name}: unit", word.unit)
        _check_text(f"{word.name}: format", word.format)
        if not _FORMAT.fullmatch(word.format):
            raise UsageError(
                f"{word.name}: the format is Q and a number of bits, integer, bits or choice, not {word.format}"
            )
    for channel in system.channels:
        _check_text("a channel", channel.name, _LOWER)
        _check_text(f"channel {channel.name}: unit", channel.unit)
    for flag in system.flags:
        _check_text("a flag", flag.name, _UPPER)
        _check_text(f"flag {flag.name}: doc", flag.doc)
    for frame in system.frames:
        _check_text("a frame", frame.name, _UPPER)
        _check_text(f"frame {frame.name}: doc", frame.doc)
        for part in (frame.half, frame.word):
            if part is not None:
                _check_text(f"frame {frame.name}: a part", part.name, _LOWER)
                if type(part.shift) is not int or not 0 <= part.shift < 32:
                    raise UsageError(f"frame {frame.name}: shift is 0 to 31, not {part.shift!r:.40}")
        if frame.half is not None and frame.half.name == frame.word.name:
            raise UsageError(f"frame {frame.name}: both parts are named {frame.word.name}")


def _check_parameters(system: System) -> None:
    """Raises UsageError for a malformed row of the system's own parameters. `plumb.spec.parameters` checks ranges."""
    for row in system.parameters:
        name = row.get("name", "without a name")
        former = row.get("was", [])
        if not isinstance(former, list) or not all(isinstance(old, str) for old in former):
            raise UsageError(f"parameter {name!s:.40}: was is a list of former names, not {former!r:.40}")
        if type(row.get("live", False)) is not bool:
            raise UsageError(f"parameter {name!s:.40}: live is true or false, not {row['live']!r:.40}")
        for key in (row.keys() - {"was", "live"}) ^ _ROW.keys():
            raise UsageError(f"parameter {name!s:.40}: {key} is {'unknown' if key in row else 'missing'}")
        for key, kind in _ROW.items():
            if type(row[key]) is not kind:
                wanted = "an integer" if kind is int else "text"
                raise UsageError(f"parameter {name!s:.40}: {key} is {wanted}, not {row[key]!r:.40}")
        _check_text("a parameter", name, _PARAMETER)
        _check_text(f"parameter {name}: doc", row["doc"])
        _check_text(f"parameter {name}: unit", row["unit"])
        if not _FORMAT.fullmatch(row["format"]):
            raise UsageError(f"parameter {name}: the format is Q and a number of bits, integer, bits or choice")
    if not isinstance(system.period, str) or group_of(system.period) not in system.all_groups:
        raise UsageError(f"period = {system.period!r:.40}: it names a parameter of the groups that the step reads")


def _check_folder(system: System) -> None:
    """Raises UsageError for a command or a part that the declaration names and the folder lacks."""
    for name, text in system.commands.items():
        _check_text(f"command {name}", text)
        if not _COMMAND.fullmatch(name):
            raise UsageError(f"commands: {name!r:.40} is no name: small letters, digits and -")
        module = f"commands/{name.replace('-', '_')}.py"
        if not (system.folder / module).is_file():
            raise UsageError(f"commands: {name} is {module}, which is missing")
    for part in system.default_for:
        _check_text("default_for", part, _LOWER)
        if not (system.folder / f"{part}.py").is_file():
            raise UsageError(f"default_for: {part} is {part}.py, which is missing")


def _check(system: System) -> None:
    if type(system.number) is not int or system.number not in NUMBERS:
        raise UsageError(f"number is an integer from 0 to {NUMBERS[-1]}, not {system.number!r:.40}")
    _check_names(system)
    _check_parameters(system)
    _check_folder(system)
    _check_units(system)
    _check_groups(system)
    if system.output and len(system.output_words) < OUTPUTS[system.output]:
        raise UsageError(f"output {system.output} is driven by {OUTPUTS[system.output]} words: the record ends before")
    if system.sensors not in SENSORS:
        raise UsageError(f"sensors is one of {', '.join(SENSORS)}, not {system.sensors}")
    if system.missing_samples not in ("held", "marked"):
        raise UsageError(f"missing_samples is held or marked, not {system.missing_samples}")
    if system.optimise not in ("speed", "size"):
        raise UsageError(f"optimise is speed or size, not {system.optimise}")
    if len(system.channels) > RAW_CHANNELS:
        raise UsageError(f"a sample has {RAW_CHANNELS} channels, not {len(system.channels)}")
    if len(system.frames) > FRAMES_MAX:
        raise UsageError(f"a system has at most {FRAMES_MAX} frames, not {len(system.frames)}")
    if len(system.flags) > 32:
        raise UsageError(f"a step has at most 32 flags, not {len(system.flags)}")
    if system.record_bytes > 4 * WORDS_MAX:
        raise UsageError(f"the record has {system.record_bytes // 4} words; {WORDS_MAX} are the most")
    at = 0
    for word in system.words:
        if word.type not in TYPES:
            raise UsageError(f"{word.name}: the type is one of {', '.join(TYPES)}, not {word.type}")
        if at % word.size:
            raise UsageError(f"{word.name} of 8 bytes would lie at byte {at}: put a word of 4 bytes before it")
        at += word.size
    if at % 8 and any(word.size == 8 for word in system.words):
        raise UsageError(f"the record has {at} bytes; with 64-bit words it is a multiple of 8: add a word of 4 bytes")
    for names in (
        [word.name for word in system.words],
        [flag.name for flag in system.flags],
        [frame.name for frame in system.frames],
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise UsageError(f"{twice[0]} is there twice")
    for frame in system.frames:
        for part in (frame.half, frame.word):
            if part is not None and part.word.size != 4:
                raise UsageError(f"frame {frame.name}: {part.word.name} has 64 bits; a part has at most 32")

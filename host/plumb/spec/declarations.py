"""Declarations of the systems: number, record, channels, parameters, frames, flags, output.

A system is a folder NAME with a file `system.toml`, either in this package or in one of the folders that the
environment variable PLUMB_SYSTEM_PATH lists. Everything that depends on the set of systems is derived from the
declarations: in Python at run time, in C by `tools/generate.py`.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

from plumb.errors import UsageError
from plumb.near_names import did_you_mean
from plumb.spec import settings
from plumb.spec.declaration_checks import check, check_commands, check_images
from plumb.spec.system import (
    OUTPUTS,
    SHIPPED,
    WORDS_MAX,
    Channel,
    Command,
    Flag,
    Frame,
    Learned,
    Member,
    Part,
    StopReason,
    System,
    TomlTable,
    Word,
    counts_for,
    in_frames,
)

BLOCKS_PATH = Path(__file__).with_name("blocks.toml")
SHARED_PATH = Path(__file__).with_name("parameters.toml")
IMAGES_PATH = Path(__file__).with_name("images.toml")
SEARCH_PATH = "PLUMB_SYSTEM_PATH"
"""Environment variable with further folders that hold folders of systems, separated as in PATH."""


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


def with_bases(chosen: Iterable[str]) -> list[System]:
    """These systems and all that they stand on, in the order of their numbers."""
    wanted, left = set[str](), list(chosen)
    while left:
        name = left.pop()
        wanted.add(name)
        left += set(system(name).stands_on) - wanted
    return [declared for name, declared in systems().items() if name in wanted]


def names() -> tuple[str, ...]:
    """Names of all systems, in the order of their numbers."""
    return tuple(systems())


def system(name: str) -> System:
    """The declaration of a system; raises UsageError for an unknown name."""
    declared = systems().get(name)
    if declared is None:
        meant, known = did_you_mean(str(name), systems()), ", ".join(systems())
        raise UsageError(f"there is no system '{name}'{meant}; this version has {known}")
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


@lru_cache(maxsize=1)
def image_limits() -> dict[str, tuple[int, int]]:
    """Table of images.toml -> the most flash and RAM of its images, in bytes."""
    tables = tomllib.loads(IMAGES_PATH.read_text(encoding="utf-8"))
    return {name: (1024 * table["flash_kib"], 1024 * table["ram_kib"]) for name, table in tables.items()}


def load_system(folder: Path, above: tuple[str, ...] = ()) -> System:
    """Read and check one declaration; raises UsageError with a sentence that names the file. above: the systems that
    stand on it, the nearest last."""
    path = folder / "system.toml"
    try:
        return _system(folder, tomllib.loads(path.read_text(encoding="utf-8")), above)
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


def _bases(given: object, above: tuple[str, ...]) -> list[System]:
    """The systems that a declaration stands on. above: the systems that stand on it, then its own name."""
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise UsageError(f"stands_on is a list of names of systems, not {given!r:.40}")
    places = {folder.name: folder for folder in folders()}
    for name in given:
        if name == above[-1]:
            raise UsageError(f"stands_on: {name} cannot stand on itself")
        if name in above:
            raise UsageError(f"stands_on: {name} stands on {above[-1]} already")
        if name not in places:
            meant, known = did_you_mean(name, places), ", ".join(sorted(places))
            raise UsageError(f"stands_on: there is no system {name!r:.40}{meant}; there are {known}")
    return [load_system(places[name], above) for name in given]


def _system(folder: Path, table: TomlTable, above: tuple[str, ...]) -> System:
    if not re.fullmatch(r"[a-z][a-z0-9]*", folder.name):
        raise UsageError("the folder's name is that of the system: small letters and digits")
    setpoint = Word(type="int32", member=table["setpoint"]["name"], **table["setpoint"])
    middle, members = _record(table["record"])
    channels = tuple(Channel(**channel) for channel in table["channels"])
    step_commands = tuple(Command(**command) for command in table.get("command", ()))
    check_commands(step_commands)
    flags = Word("flags", "uint32", "", "bits", "of this step", "flags")
    step = Word("step", "uint32", "step", "integer", "number of this step in the run, from 1", "step")
    words = (*_inputs(channels, step_commands), setpoint, *middle, flags, step)
    by_name = {word.name: word for word in words}
    output = table.get("output", {"kind": ""})
    if not isinstance(table["groups"], list):
        raise UsageError(f"groups is a list of names, not {table['groups']!r:.40}")
    structs = dict(table.get("structs", {}))
    bases = _bases(table.get("stands_on", []), (*above, folder.name))
    declared = System(
        name=folder.name,
        number=table["number"],
        title=table["title"],
        folder=folder,
        cycles=table.get("cycles"),
        cycles_mean=table.get("cycles_mean"),
        optimise=table.get("optimise", "speed"),
        channels=channels,
        sensors=table["sensors"],
        missing_samples=table.get("missing_samples", "held"),
        words=words,
        members=tuple(members),
        flags=tuple(Flag(**{"saturated": False, **flag}) for flag in table["flags"]),
        frames=tuple(_frame(frame, by_name) for frame in table["frames"]),
        output=output["kind"],
        output_words=_output_words(output, words),
        period=table["period"],
        groups=tuple(table["groups"]),
        parameters=_parameters(table),
        conditions=tuple(table.get("condition", ())),
        includes=tuple(structs.pop("includes", ())),
        structs=structs,
        commands=dict(table.get("commands", {})),
        default_for=tuple(table.get("default_for", ())),
        images=tuple(table.get("images", ())),
        in_all=table.get("in_all", True),
        flash_kib=table.get("flash_kib"),
        accel_bus_max=table.get("accel_bus_max"),
        step_commands=step_commands,
        command_source=table.get("command_source", "link"),
        learned=Learned(**table["learned"]) if "learned" in table else None,
        stands_on=tuple(base.name for base in bases),
        base_groups=tuple(dict.fromkeys(group for base in bases for group in base.all_groups)),
        checks=output.get("checks", ""),
        unchecked=output.get("unchecked", ""),
        stop_reasons=tuple(StopReason(**reason) for reason in table.get("stop_reasons", ())),
        setting_groups=tuple(settings.read_group(name, group) for name, group in table.get("settings", {}).items()),
        own_settings=tuple(settings.read(setting) for setting in table.get("setting", ())),
    )
    check(declared, shared()["parameter"], [row for base in bases for row in base.parameters])
    check_images(declared, tuple(image_limits()))
    return declared


def _parameters(table: TomlTable) -> tuple[TomlTable, ...]:
    """The rows of a system's own parameters. One with a setting and without a factory value has that of its setting, at
    the period `factory_us`."""
    factory_us, rows = table.get("factory_us", 0), []
    if type(factory_us) is not int or factory_us < 0:
        raise UsageError(f"factory_us is a period in us, not {factory_us!r:.40}")
    for row in table.get("parameter", ()):
        new = {"owner": "control", **row}
        if "setting" in row:
            new["setting"] = setting = settings.read(row["setting"], row.get("doc", ""))
            if not setting.conversion:
                raise UsageError(f"setting {setting.name}: conversion is missing; without one it is a [[setting]]")
            if factory_us and "default" not in row and setting.default is not None:
                new["default"] = settings.factory_word(setting, row["format"], row["max"], Fraction(factory_us, 10**6))
        rows.append(new)
    return tuple(rows)


def _inputs(channels: Sequence[Channel], step_commands: Sequence[Command]) -> Iterator[Word]:
    """The words of a record that hold the inputs of its step: the counts, then the 16-bit words of the commands."""
    counts = counts_for(len(channels))
    for i in range(counts):
        yield Word(f"raw_{i}", "int32", "count", "integer", "count as given", f"raw[{i}]")
    at = counts
    for command in step_commands:
        halves = ("",) if command.size == 1 else ("_low", "_high")
        for half in halves:
            unit, form = (command.unit, command.format) if not half else ("", "bits")
            yield Word(command.name + half, "int32", unit, form, f"as given: {command.doc}", f"raw[{at}]")
            at += 1
    for i in range(at, counts + in_frames(at - counts)):
        yield Word(f"unused_{i}", "int32", "", "integer", "0", f"raw[{i}]")


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

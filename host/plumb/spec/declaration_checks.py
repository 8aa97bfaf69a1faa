"""Checks of a declaration: each raises UsageError with one sentence that says what is wrong.

`plumb.spec.declarations` adds the name of the file.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from plumb.errors import UsageError
from plumb.spec import imu_chips
from plumb.spec.base_units import BASE_UNITS, unknown_part
from plumb.spec.system import (
    CHECKED_CHANNELS,
    CHECKS,
    COMMAND_SOURCES,
    COMMAND_TYPES,
    COMMAND_WORDS_MAX,
    COUNTS_MAX,
    FRAMES_MAX,
    NUMBERS,
    OUTPUTS,
    OWN,
    RECEIVER,
    SENSORS,
    STICKS,
    STOP_REASON,
    STOP_REASONS_MAX,
    TYPES,
    UNCHECKED,
    WORDS_MAX,
    Command,
    System,
    TomlTable,
    group_of,
)

_C_KEYWORDS = frozenset(
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
FLASH_KIB_MOST = 60
"""Flash of an STM32F103C8 below its parameters."""
UNLISTED_IMAGES = ("alone", "alone_on_others", "all")
"""Tables of images.toml that every system is in: its own image, and that of all systems."""
_OPTIONAL = {"was", "live", "weakens", "armed", "harmless", "setting"}


def _check_text(what: str, value: object, pattern: re.Pattern[str] | None = None) -> None:
    """Raises UsageError unless the value is a line of text that fits into C comments and the DBC, and, with a pattern,
    a name that matches it."""
    if not isinstance(value, str) or not value.isprintable() or "*/" in value or '"' in value:
        raise UsageError(f"{what} is a line of text without quotes or */, not {value!r:.40}")
    if pattern is not None and (not pattern.fullmatch(value) or value in _C_KEYWORDS):
        raise UsageError(f"{what}: {value!r:.40} cannot be a name in C and in the DBC: letters, digits and _")


def _check_units(system: System) -> None:
    """Raises UsageError for a unit with a part that is neither a base unit nor one of the system's quantities."""
    own = [word.name for word in system.words]
    own += [row["name"].rpartition(".")[2] for row in system.parameters]
    stated = [(f"word {word.name}", word.unit) for word in system.words]
    stated += [(f"channel {channel.name}", channel.unit) for channel in system.channels]
    stated += [(f"command {command.name}", command.unit) for command in system.step_commands]
    stated += [(f"parameter {row['name']}", row["unit"]) for row in system.parameters]
    for what, unit in stated:
        part = unknown_part(unit, own)
        if part:
            raise UsageError(f"{what}: unit '{unit:.40}' has '{part:.40}'; units are {' '.join(sorted(BASE_UNITS))}")


def _check_groups(system: System, shared: Sequence[TomlTable], of_bases: Sequence[TomlTable]) -> None:
    """Raises UsageError for an unknown shared group, for an own group that a system below has, and for a channel whose
    axis or calibration is wrong."""
    rows = [*shared, *of_bases, *system.parameters]
    for row in system.parameters:
        if group_of(row["name"]) in system.base_groups:
            raise UsageError(
                f"parameter {row['name']}: {', '.join(system.stands_on)}, on which it stands, has this group"
            )
    known = list(dict.fromkeys(group_of(row["name"]) for row in shared if row["owner"] == "control"))
    for group in system.groups:
        if group not in known:
            raise UsageError(f"groups: there is no shared group {group!r:.40}; there are {', '.join(known)}")
    for channel in system.channels[CHECKED_CHANNELS:]:
        if channel.calibration:
            raise UsageError(f"channel {channel.name}: only the first {CHECKED_CHANNELS} may have a calibration")
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
    for reason in system.stop_reasons:
        _check_text("a stop reason", reason.name, _LOWER)
        _check_text(f"stop reason {reason.name}: doc", reason.doc)
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


def _check_stop_reasons(system: System) -> None:
    """Raises UsageError for reasons without the word that has them, and for a bit that is none or another reason's."""
    if system.stop_reasons and all(word.name != STOP_REASON for word in system.words):
        raise UsageError(f"stop_reasons: the record has no word {STOP_REASON}")
    taken: dict[int, str] = {}
    for reason in system.stop_reasons:
        if type(reason.bit) is not int or not 0 <= reason.bit < STOP_REASONS_MAX:
            raise UsageError(f"stop reason {reason.name}: bit is 0 to {STOP_REASONS_MAX - 1}, not {reason.bit!r:.40}")
        if reason.bit in taken:
            raise UsageError(f"stop reason {reason.name}: bit {reason.bit} is that of {taken[reason.bit]}")
        taken[reason.bit] = reason.name


def _check_arming(system: System, row: TomlTable) -> None:
    """Raises UsageError for a row of a system that drives something and does not say which promise it can weaken."""
    name, weakens, armed = row["name"], row.get("weakens", []), row.get("armed", [])
    if not isinstance(weakens, list) or not all(type(number) is int for number in weakens):
        raise UsageError(f"parameter {name}: weakens is a list of the numbers of promises, not {weakens!r:.40}")
    if armed and not (isinstance(armed, list) and len(armed) == 2 and all(type(end) is int for end in armed)):
        raise UsageError(f"parameter {name}: armed is the least and the largest integer, not {armed!r:.40}")
    _check_text(f"parameter {name}: harmless", row.get("harmless", ""))
    if system.output and not weakens and not row.get("harmless"):
        raise UsageError(
            f"parameter {name}: weakens names the promises (docs/explanation/security.md) that it can weaken, "
            "or harmless says why it can weaken none"
        )


def _check_output_checks(system: System) -> None:
    """Raises UsageError for an output without checks, and for checks that the rest of the declaration contradicts."""
    own = [flag.name for flag in system.flags if flag.fails or flag.unready]
    for flag in system.flags:
        if any(type(value) is not bool for value in (flag.saturated, flag.fails, flag.unready)):
            raise UsageError(f"flag {flag.name}: saturated, fails and unready are true or false")
    if own and system.checks != OWN:
        raise UsageError(f'flag {own[0]}: fails and unready are for an output with checks = "{OWN}"')
    if not system.output:
        return
    if not isinstance(system.checks, str) or system.checks not in CHECKS:
        raise UsageError(f"output.checks is one of {', '.join(CHECKS)}, not {system.checks or 'missing'!r:.40}")
    if system.checks == OWN and not own:
        raise UsageError('output.checks = "own": no flag says fails = true or unready = true')
    _check_text("output.unchecked", system.unchecked)
    if bool(system.unchecked) != (system.checks == UNCHECKED):
        raise UsageError('output.unchecked says why nothing is checked; it comes with checks = "none", and only then')


def _check_parameters(system: System) -> None:
    """Raises UsageError for a malformed row of the system's own parameters. `plumb.spec.parameters` checks ranges."""
    for row in system.parameters:
        name = row.get("name", "without a name")
        former = row.get("was", [])
        if not isinstance(former, list) or not all(isinstance(old, str) for old in former):
            raise UsageError(f"parameter {name!s:.40}: was is a list of former names, not {former!r:.40}")
        if type(row.get("live", False)) is not bool:
            raise UsageError(f"parameter {name!s:.40}: live is true or false, not {row['live']!r:.40}")
        for key in (row.keys() - _OPTIONAL) ^ _ROW.keys():
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


def _check_settings(system: System) -> None:
    """Raises UsageError for a setting whose group is not declared, a name that two have, and types that differ."""
    groups = {group.name: group for group in system.setting_groups}
    names = [setting.name for setting in system.settings]
    for setting in system.settings:
        if setting.group not in groups:
            raise UsageError(f"setting {setting.name}: the table settings has no {setting.group}")
        if names.count(setting.name) > 1:
            raise UsageError(f"setting {setting.name} is there twice")
    kinds = {group.type: _fields_of(system, group.name) for group in groups.values()}
    for group in groups.values():
        if _fields_of(system, group.name) != kinds[group.type]:
            raise UsageError(f"settings: the groups of type {group.type} differ in their settings")


def _fields_of(system: System, group: str) -> list[tuple[object, ...]]:
    """What a class of settings consists of."""
    return [
        (setting.name.rpartition(".")[2], setting.unit, setting.doc, setting.default, setting.type)
        for setting in system.settings
        if setting.group == group
    ]


def _check_folder(system: System) -> None:
    """Raises UsageError for a command or a part that the declaration names and its folders lack."""
    for name, text in system.commands.items():
        _check_text(f"command {name}", text)
        if not _COMMAND.fullmatch(name):
            raise UsageError(f"commands: {name!r:.40} is no name: small letters, digits and -")
        module = f"commands/{name.replace('-', '_')}.py"
        if not (system.judging / module).is_file():
            raise UsageError(f"commands: {name} is {module}, which is missing")
    for part in system.default_for:
        _check_text("default_for", part, _LOWER)
        if not any((folder / f"{part}.py").is_file() for folder in (system.folder, system.judging)):
            raise UsageError(f"default_for: {part} is {part}.py, which is missing")


def check_commands(commands: Sequence[Command]) -> None:
    """Raises UsageError for a malformed input that a host sets."""
    for command in commands:
        _check_text("a command", command.name, _LOWER)
        _check_text(f"command {command.name}: doc", command.doc)
        _check_text(f"command {command.name}: unit", command.unit)
        if not isinstance(command.type, str) or command.type not in COMMAND_TYPES:
            raise UsageError(
                f"command {command.name}: the type is {' or '.join(COMMAND_TYPES)}, not {command.type!r:.40}"
            )
        if not isinstance(command.format, str) or not _FORMAT.fullmatch(command.format):
            raise UsageError(f"command {command.name}: the format is Q and a number of bits, integer, bits or choice")
        most = 1 << COMMAND_TYPES[command.type] - 1
        for key in ("low", "high", "default"):
            if type(value := getattr(command, key)) is not int:
                raise UsageError(f"command {command.name}: {key} is an integer, not {value!r:.40}")
        if not -most <= command.low <= command.default <= command.high < most:
            raise UsageError(
                f"command {command.name}: low {command.low}, default {command.default} and high {command.high} "
                f"have to rise and fit {command.type}"
            )
    words = sum(command.size for command in commands)
    if words > COMMAND_WORDS_MAX:
        raise UsageError(f"commands have at most {COMMAND_WORDS_MAX} words of 16 bits, not {words}")


def _check_sticks(system: System) -> None:
    """Raises UsageError unless the first commands are those that a receiver sets, and the setpoint is a throttle."""
    first = system.step_commands[: len(STICKS)]
    given = {command.name: command.low for command in first if command.type == "int16"}
    if list(given.items()) != list(STICKS.items()) or system.setpoint.format != "Q15":
        wanted = ", ".join(f"{name} (from {low})" for name, low in STICKS.items())
        raise UsageError(f'command_source = "receiver": first come {wanted}, all int16, and the setpoint is Q15')


def _check_learned(system: System, rows: Sequence[TomlTable]) -> None:
    """Raises UsageError unless what SAVE keeps is a word of the record, and a parameter of the same form that does not
    change in a run."""
    if system.learned is None:
        return
    word = next((word for word in system.words if word.name == system.learned.word), None)
    row = next((row for row in rows if row["name"] == system.learned.parameter), None)
    if word is None or word is system.words[0]:
        raise UsageError(f"learned: the record has no word {system.learned.word!r:.40} that a step learns")
    if row is None or group_of(row["name"]) not in system.all_groups:
        raise UsageError(f"learned: the step reads no parameter {system.learned.parameter!r:.40}")
    if (word.type, word.format) != (row["type"], row["format"]) or row.get("live", False):
        raise UsageError(
            f"learned: {row['name']} has the type and the format of {word.name}, {word.type} {word.format}, and is not"
            " live"
        )


def check(system: System, shared: Sequence[TomlTable], of_bases: Sequence[TomlTable] = ()) -> None:
    """Raises UsageError with the first mistake of a declaration. shared: the rows of the shared parameter groups;
    of_bases: the own rows of the systems that it stands on."""
    if type(system.number) is not int or system.number not in NUMBERS:
        raise UsageError(f"number is an integer from 0 to {NUMBERS[-1]}, not {system.number!r:.40}")
    _check_names(system)
    _check_parameters(system)
    _check_settings(system)
    _check_folder(system)
    _check_units(system)
    _check_groups(system, shared, of_bases)
    _check_learned(system, [*shared, *of_bases, *system.parameters])
    if system.output and len(system.output_words) < OUTPUTS[system.output]:
        raise UsageError(f"output {system.output} is driven by {OUTPUTS[system.output]} words: the record ends before")
    _check_output_checks(system)
    for row in system.parameters:
        _check_arming(system, row)
    if system.sensors not in SENSORS:
        raise UsageError(f"sensors is one of {', '.join(SENSORS)}, not {system.sensors}")
    if system.missing_samples not in ("held", "marked"):
        raise UsageError(f"missing_samples is held or marked, not {system.missing_samples}")
    if not isinstance(system.in_all, bool):
        raise UsageError(f"in_all is true or false, not {system.in_all!r:.40}")
    if system.flash_kib is not None and system.flash_kib not in range(1, FLASH_KIB_MOST + 1):
        raise UsageError(f"flash_kib is a whole number of 1 to {FLASH_KIB_MOST}, not {system.flash_kib!r:.40}")
    if system.accel_bus_max is not None and system.accel_bus_max not in range(len(imu_chips.ways())):
        raise UsageError(f"accel_bus_max is a way that sensors are wired, not {system.accel_bus_max!r:.40}")
    if system.optimise not in ("speed", "size"):
        raise UsageError(f"optimise is speed or size, not {system.optimise}")
    if len(system.channels) > COUNTS_MAX:
        raise UsageError(f"a sample has at most {COUNTS_MAX} channels, not {len(system.channels)}")
    if system.command_source not in COMMAND_SOURCES:
        raise UsageError(f"command_source is one of {', '.join(COMMAND_SOURCES)}, not {system.command_source!r:.40}")
    if system.command_source == RECEIVER:
        _check_sticks(system)
    if len(system.frames) > FRAMES_MAX:
        raise UsageError(f"a system has at most {FRAMES_MAX} frames, not {len(system.frames)}")
    _check_stop_reasons(system)
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


def check_images(system: System, tables: Sequence[str]) -> None:
    """Raises UsageError unless each set that the system lists is one of images.toml, whose tables are given, and none
    of these has the system's own name."""
    if system.name in tables:
        raise UsageError(f"'{system.name}' is the name of a set of images; rename the folder")
    sets = [name for name in tables if name not in UNLISTED_IMAGES]
    for name in system.images:
        if name not in sets:
            raise UsageError(f"images: there is no set {name!r:.40}; images.toml has {', '.join(sets)}")

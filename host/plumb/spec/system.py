"""What a declared system is: its record, channels, parameters, frames, flags and output, and how much of each fits.

`plumb.spec.declarations` reads it from the files, `plumb.spec.declaration_checks` says what is wrong with one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from plumb.checkout import PACKAGE
from plumb.errors import UsageError
from plumb.spec.settings import Setting, SettingGroup

TomlTable = Mapping[str, Any]  # Any: values as TOML gives them; they are checked when the declaration is loaded
"""A table of a declaration."""

SHIPPED = PACKAGE / "systems"
JUDGING = PACKAGE / "judging"
"""Where the systems of this package are."""
COUNTS_LEAST, COUNTS_MAX = 6, 12
"""Raw counts of a record: six, or as many as the channels need, in threes, because a frame carries three."""
COMMAND_WORDS_MAX = 16
"""Most 16-bit words of the commands of a step."""
CHECKED_CHANNELS = 8
"""The first channels, which may have a calibration: SENSORS has a bit for a rail and one for no change of so many."""
WORDS_PER_FRAME = 3
"""16-bit words of inputs in one frame."""
COMMAND_TYPES = {"int16": 16, "int32": 32}
"""Type of a command -> bits."""
COMMAND_SOURCES = ("owner", "link", "receiver")
"""Where the commands of a run come from: its owner alone, or the link that RUN_BEGIN names; `receiver`: in real time
the radio receiver on the board if the parameter `receiver` names its protocol, else the owner."""
RECEIVER, BATTERY = "receiver", "battery"
"""The source of commands, and the part of a board that only images with such a system have."""
STICKS = {"roll": -32767, "pitch": -32767, "yaw": -32767, "switches": 0, "receiver": 0}
"""First commands of a system that a receiver may fly, in this order -> their least value (firmware/link/receiver.h)."""
NUMBERS = range(18)
"""Numbers that a system may have. The number is the high byte of its signal numbers and selects its block of CAN
identifiers."""
WORDS_MAX = 255
"""Most 32-bit words in a record: a word's place is the low byte of its signal number."""
FRAMES_MAX = 12
"""Most frames of one system: each needs an entry in the frame counters of a link."""
TYPES = {"int32": "<i4", "uint32": "<u4", "int64": "<i8"}
"""Type of a declared word -> numpy type."""
SENSORS = ("NONE", "ANALOG_3", "ANALOG_6", "BALANCE", "SIX_AXES", "RIDE")
"""Sensor sets that a board can sample (CONTROL_SENSORS_ in firmware/systems/control.h)."""
OUTPUTS = {"PULSES": 2, "BRIDGE": 1, "ROTORS": 4, "WHEELS": 2}
"""Kind of actuator (CONTROL_OUTPUT_) -> number of record words that drive it."""
STOP_REASON = "stop_reason"
STOP_REASONS_MAX = 8
"""Word of a record that says why the step has stopped the motors, and the most bits that it may have."""
WITH_BATTERY = ("ROTORS", "WHEELS")
"""Kinds whose pin set reads the battery."""
UNUSED = "not used"
"""`doc` of the setpoint of a system that reads none."""
AXIS, FLIGHT, RIDE, OWN, UNCHECKED = "axis", "flight", "ride", "own", "none"
CHECKS = {
    AXIS: "gyro and accelerometer of one tilted axis agree, and it stands still (include/plumb/plausibility.h)",
    FLIGHT: "it stands still and level with the throttle low (include/plumb/takeoff.h)",
    RIDE: "as axis, and the step says why it has stopped the motors",
    OWN: "flags of the step",
    UNCHECKED: "nothing, for the reason that `unchecked` gives",
}
"""`checks` of an output -> what decides whether the board may be armed, and whether it stays so."""


CHOICE = re.compile(r"(\d+): ([^;]+)")
"""A value and its meaning in the doc of a choice."""


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

    @property
    def choices(self) -> dict[int, str]:
        """Meaning of each value of a word of format `choice`, which its doc lists as `0: flown; 1: held`; {} of any
        other word."""
        return {int(value): text.strip() for value, text in CHOICE.findall(self.doc)} if self.format == "choice" else {}


@dataclass(frozen=True)
class Member:
    """One member of the record's C struct. count: 0 for a single value, else the length of the array."""

    struct: str
    name: str
    count: int
    doc: str


@dataclass(frozen=True)
class Flag:
    """One bit of the word `flags`. saturated: a raw count was outside its range. fails, unready: what it does as one of
    a system's own checks: while it is set the board is disarmed and cannot be armed, or only cannot be armed."""

    name: str
    saturated: bool
    doc: str
    fails: bool = False
    unready: bool = False


@dataclass(frozen=True)
class StopReason:
    """One bit of the word `stop_reason`: why the step itself has stopped the motors.

    bit: 0 to 7; in PLAUSIBILITY.failed and disarmed_by it is 8 higher. doc: what stopped them, and what
    to do.
    """

    bit: int
    name: str
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
class Command:
    """One input of a step that a host sets, besides the setpoint. All numbers are integers of its type.

    low, high: limits; the board refuses a set of commands with a value beyond them. default: the value at the start of
    a run, after disarming, and when the source of commands is silent.
    """

    name: str
    type: str
    unit: str
    format: str
    low: int
    high: int
    default: int
    doc: str

    @property
    def size(self) -> int:
        """Number of 16-bit words."""
        return COMMAND_TYPES[self.type] // 16

    def words(self, value: int) -> tuple[int, ...]:
        """A value as 16-bit words, signed, the low one first."""
        return tuple((value >> 16 * i & 0xFFFF ^ 0x8000) - 0x8000 for i in range(self.size))

    def value(self, words: Sequence[int]) -> int:
        """The value of its words."""
        *low, high = words
        return high << 16 * len(low) | sum((word & 0xFFFF) << 16 * i for i, word in enumerate(low))


class Learned(NamedTuple):
    """What a run learns and SAVE keeps: the word of the record, and the parameter that the next run begins with."""

    word: str
    parameter: str


@dataclass(frozen=True)
class System:
    """One declared system.

    words: all words of its record; members: the C struct members between setpoint and flags.
    cycles: cycle budget of a step, cycles_mean of the mean step where work is spread over steps; None without a budget.
    missing_samples: `held` (the last sample is used again) or
    `marked` (every count is -32768). output: "" without an actuator, else a key of OUTPUTS; output_words drive it.
    checks: "" without an actuator, else a key of CHECKS; unchecked: the reason for UNCHECKED.
    stop_reasons: bits of the word `stop_reason`, () without that word.
    setting_groups: groups of settings in engineering units; own_settings: those that are no single parameter.
    period: the parameter that holds the period of a step in s.
    groups: shared parameter groups that the step reads; parameters: rows of the system's own groups.
    stands_on: systems whose step this one calls; base_groups: the groups that those read. all_groups: all of these.
    conditions: what must hold of several words while the board is armed (`plumb.spec.armed_values`).
    structs: group -> C struct of the kernel that reads it; includes: headers of those structs.
    step_commands: inputs of a step that a host sets besides the setpoint; command_source: who may send them, and the
    setpoint (COMMAND_SOURCES).
    learned: what a run on the board's own sensors learns and SAVE keeps; None: nothing.
    commands: the system's own commands of the command line, name -> one sentence; their modules are in the folder
    `commands` of judging.
    default_for: parts (`replay`, `demo`) for which this system is the default of the command.
    images: sets of flash images that hold the system, besides its own and `all` (images.toml); in_all: False for one
    that `all` leaves out, because a C8 has no room for it. flash_kib: the most that its own image may take, None: the
    limit of images.toml. accel_bus_max: the greatest value of that parameter in its own image, which has no room for
    the sensors beyond it (`imu_chips`); None: all.
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
    conditions: tuple[TomlTable, ...]
    structs: Mapping[str, str]
    includes: tuple[str, ...]
    commands: Mapping[str, str]
    default_for: tuple[str, ...]
    images: tuple[str, ...]
    in_all: bool = True
    flash_kib: int | None = None
    accel_bus_max: int | None = None
    step_commands: tuple[Command, ...] = ()
    command_source: str = "link"
    learned: Learned | None = None
    stands_on: tuple[str, ...] = ()
    base_groups: tuple[str, ...] = ()
    checks: str = ""
    unchecked: str = ""
    stop_reasons: tuple[StopReason, ...] = ()
    setting_groups: tuple[SettingGroup, ...] = ()
    own_settings: tuple[Setting, ...] = ()

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The settings in engineering units: those without a conversion, then those of the parameters."""
        return (*self.own_settings, *(row["setting"] for row in self.parameters if "setting" in row))

    @property
    def shipped(self) -> bool:
        """True for a system of this package, False for one on PLUMB_SYSTEM_PATH."""
        return self.folder.parent == SHIPPED

    @property
    def judging(self) -> Path:
        """The folder of what judges the system: plots, figures, limits, comparisons, commands. It may be missing."""
        return (JUDGING if self.shipped else self.folder.parent / JUDGING.name) / self.name

    @property
    def is_driven(self) -> bool:
        """True for a system with an actuator: it may be armed."""
        return self.output in OUTPUTS

    @property
    def counts(self) -> int:
        """Number of raw counts of a step."""
        return counts_for(len(self.channels))

    @property
    def command_words(self) -> int:
        """Number of 16-bit words of the commands of a step."""
        return sum(command.size for command in self.step_commands)

    @property
    def inputs(self) -> int:
        """Number of 16-bit inputs of a step: the counts, then the words of the commands, in whole frames."""
        return self.counts + in_frames(self.command_words)

    @property
    def setpoint(self) -> Word:
        """The setpoint of a step."""
        return self.words[self.inputs]

    def default_commands(self) -> tuple[int, ...]:
        """The inputs behind the counts when no host has set them, in whole frames."""
        return self.pack_commands({})

    def command_places(self) -> list[int]:
        """Place of each command's first word among the inputs."""
        sizes = [command.size for command in self.step_commands]
        return [self.counts + sum(sizes[:i]) for i in range(len(sizes))]

    def whole_inputs(self, given: Sequence[int]) -> list[int]:
        """All inputs of a step from the first ones: counts that are not given are 0, commands have their defaults."""
        whole = [*given[: self.inputs], *(0,) * (self.counts - len(given))]
        return [*whole, *self.default_commands()[len(whole) - self.counts :]]

    def pack_commands(self, values: Mapping[str, int]) -> tuple[int, ...]:
        """The inputs behind the counts with these values; commands that are not given have their defaults.

        Raises UsageError for an unknown name and for a value beyond its limits.
        """
        known = [command.name for command in self.step_commands]
        for name in values:
            if name not in known:
                raise UsageError(f"{self.name} has no command '{name}'; it has {', '.join(known) or 'none'}")
        words: list[int] = []
        for command in self.step_commands:
            value = values.get(command.name, command.default)
            if not command.low <= value <= command.high:
                raise UsageError(f"{self.name}: {command.name} is {command.low} to {command.high}, not {value}")
            words += command.words(value)
        return (*words, *(0,) * (self.inputs - self.counts - len(words)))

    @property
    def all_groups(self) -> tuple[str, ...]:
        """The parameter groups that the step reads: shared groups, those of what it stands on, then its own."""
        own = (group_of(row["name"]) for row in self.parameters)
        return tuple(dict.fromkeys((*self.groups, *self.base_groups, *own)))

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts of a board that have parameters of their own (`part` in parameters.toml), and that it uses."""
        return (RECEIVER,) * (self.command_source == RECEIVER) + (BATTERY,) * (self.output in WITH_BATTERY)

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


def in_frames(words: int) -> int:
    """So many words, filled up to whole frames."""
    return -(-words // WORDS_PER_FRAME) * WORDS_PER_FRAME


def counts_for(channels: int) -> int:
    """Number of raw counts of a step with so many channels."""
    return max(COUNTS_LEAST, in_frames(channels))


@lru_cache(maxsize=1024)
def group_of(parameter: str) -> str:
    """The group of a parameter, from its name: `kalman` of kalman.qb; "" for a parameter without a group."""
    return parameter.rpartition(".")[0]

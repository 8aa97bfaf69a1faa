"""What a declared system is: its record, channels, parameters, frames, flags and output, and how much of each fits.

`plumb.spec.declarations` reads it from the files, `plumb.spec.declaration_checks` says what is wrong with one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plumb.checkout import PACKAGE
from plumb.errors import UsageError

TomlTable = Mapping[str, Any]  # Any: values as TOML gives them; they are checked when the declaration is loaded
"""A table of a declaration."""

SHIPPED = PACKAGE / "systems"
JUDGING = PACKAGE / "judging"
"""Where the systems of this package are."""
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
    conditions: what must hold of several words while the board is armed (`plumb.spec.armed_values`).
    structs: group -> C struct of the kernel that reads it; includes: headers of those structs.
    commands: the system's own commands, name -> one sentence; their modules are in the folder `commands` of judging.
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
    conditions: tuple[TomlTable, ...]
    structs: Mapping[str, str]
    includes: tuple[str, ...]
    commands: Mapping[str, str]
    default_for: tuple[str, ...]

    @property
    def shipped(self) -> bool:
        """True for a system of this package, False for one on PLUMB_SYSTEM_PATH."""
        return self.folder.parent == SHIPPED

    @property
    def judging(self) -> Path:
        """The folder of what judges the system: plots, figures, limits, comparisons, commands. It may be missing."""
        return (JUDGING if self.shipped else self.folder.parent / JUDGING.name) / self.name

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


def group_of(parameter: str) -> str:
    """The group of a parameter, from its name: `kalman` of kalman.qb; "" for a parameter without a group."""
    return parameter.rpartition(".")[0]

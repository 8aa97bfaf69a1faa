"""The DBC for other tools (`messages.dbc`): the messages of plumb with every flag as a signal of one bit.

plumb itself packs and unpacks 16-bit and 32-bit words (`plumb.spec.dbc`), and the hash that board and host compare is
taken over these. SavvyCAN, cantools and Wireshark draw signals: a word of flags is shown here bit by bit, a word of two
numbers as two signals, and numbers of frames and steps have that unit. Places and frames are the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from plumb.spec import dbc, declarations, status_bits
from plumb.spec.status_bits import ANALOG_INPUTS, SENSOR_STATES, Bit

_MESSAGE = re.compile(r"^BO_ (\d+) (\w+): ")
_SIGNAL = re.compile(r"^ SG_ (\w+) : (\d+)\|(\d+)@1([+-]) (\(\S+\)) (\[\S+\]) \"([^\"]*)\" (\w+)$")
_COMMENT = re.compile(r"^CM_ SG_ (\d+) (\w+) ")


@dataclass(frozen=True)
class Field:
    """A signal inside a word. choices: names of its values, from 0 on."""

    name: str
    first: int
    bits: int
    comment: str
    choices: tuple[str, ...] = ()


def _flags(prefix: str, bits: Mapping[int, Bit]) -> list[Field]:
    return [Field(f"{prefix}_{one.name}", bit, 1, one.text) for bit, one in bits.items()]


def _link_fields() -> dict[tuple[str, str], list[Field]]:
    """(message, word) -> its signals, for the messages of the link."""
    rails = [Field(f"rail_{pin}", bit, 1, "at 0 or 4095 for rail_ms") for bit, pin in enumerate(ANALOG_INPUTS)]
    stuck = [Field(f"stuck_{pin}", 8 + bit, 1, "no change for stuck_ms") for bit, pin in enumerate(ANALOG_INPUTS)]
    states = tuple(state.name for state in SENSOR_STATES.values())
    chips = [
        Field(f"{chip}_state", first, 8, "good, or why it is not", states)
        for chip, first in (("gyro", 0), ("accelerometer", 8))
    ]
    implausible = status_bits.IMPLAUSIBLE | status_bits.stop_reason_signals()
    return {
        ("STATUS", "blocked"): _flags("blocked", status_bits.BLOCKED),
        ("STATUS", "faults"): _flags("fault", status_bits.FAULTS),
        ("EVENTS", "disarm_cause"): _flags("disarmed", status_bits.BLOCKED),
        ("SENSORS", "analog"): rails + stuck,
        ("SENSORS", "digital"): chips,
        ("PLAUSIBILITY", "failed"): _flags("failed", implausible),
        ("PLAUSIBILITY", "missing"): _flags("missing", status_bits.NOT_READY),
        ("PLAUSIBILITY", "disarmed_by"): _flags("disarmed_by", implausible),
    }


def _system_fields() -> dict[tuple[str, str], list[Field]]:
    """The same for the word `flags` in the frames of the systems."""
    return {
        (dbc.frame_name(system, frame), part.name): [
            Field(f"flag_{flag.name.lower()}", bit, 1, flag.doc) for bit, flag in enumerate(system.flags)
        ]
        for system in declarations.systems().values()
        for frame in system.frames
        for part in (frame.half, frame.word)
        if part is not None and part.word.name == "flags"
    }


UNITS = {
    ("COUNTERS", "rejected"): "frames",
    ("COUNTERS", "lost"): "frames",
    ("COUNTERS", "dropped"): "frames",
    ("EVENTS", "saturated"): "steps",
    ("EVENTS", "starved"): "steps",
}
"""Units that the words of the link do not have."""


def text() -> str:
    """The whole file."""
    fields = {**_link_fields(), **_system_fields()}
    lines: list[str] = []
    comments: dict[tuple[str, str], list[str]] = {}
    values: list[str] = []
    identifier = message = ""
    for line in dbc.text().splitlines():
        if found := _MESSAGE.match(line):
            identifier, message = found[1], found[2]
        signal = _SIGNAL.match(line)
        split = fields.pop((message, signal[1]), None) if signal else None
        if signal and split is not None:
            lines += [_signal(int(signal[2]), field, signal[8]) for field in split]
            comments[identifier, signal[1]] = [f'CM_ SG_ {identifier} {f.name} "{f.comment}";' for f in split]
            values += [_values(identifier, field) for field in split if field.choices]
        elif signal:
            lines.append(_with_unit(line, signal, UNITS.get((message, signal[1]))))
        elif (comment := _COMMENT.match(line)) and (comment[1], comment[2]) in comments:
            lines += comments.pop((comment[1], comment[2]))
        else:
            lines.append(line)
    unused = [*fields, *comments]
    if unused:
        raise ValueError(f"the DBC has no word or no comment for {unused}")
    return "\n".join([*lines, *values]) + "\n"


def _signal(word_start: int, field: Field, receiver: str) -> str:
    largest = (1 << field.bits) - 1
    return f' SG_ {field.name} : {word_start + field.first}|{field.bits}@1+ (1,0) [0|{largest}] "" {receiver}'


def _with_unit(line: str, signal: re.Match[str], unit: str | None) -> str:
    """The line with another unit; `command`, which is a share of the full drive, has none."""
    unit = "" if signal[7] == "command" else unit
    return line if unit is None else line[: signal.start(7)] + unit + line[signal.end(7) :]


def _values(identifier: str, field: Field) -> str:
    return f"VAL_ {identifier} {field.name} " + " ".join(f'{k} "{name}"' for k, name in enumerate(field.choices)) + " ;"

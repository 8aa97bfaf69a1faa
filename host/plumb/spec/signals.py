"""The signals of a system's telemetry frames as columns of a table: column name with unit, and scale."""

from __future__ import annotations

from functools import lru_cache

from plumb.spec import dbc, declarations
from plumb.spec.protocol import load_database

UNITS = {"deg": "_deg", "deg/s": "_dps", "us": "_us", "m/s": "_mps"}
"""Unit in the DBC -> suffix of the column's name."""

Signal = tuple[str, str]
"""(message, signal) as the DBC names them."""


@lru_cache(maxsize=32)
def signals(system: str) -> list[tuple[Signal, str, float]]:
    """(signal, column, scale) of all frames of a system, in order. scale: value of one LSB.

    A column is named after its signal; if an earlier frame has a signal of that name, after the frame or after both."""
    found: list[tuple[Signal, str, float]] = []
    taken: set[str] = set()
    database = load_database()
    for name in dbc.frame_names(system):
        message = database.get_message_by_name(name)
        for signal in sorted(message.signals, key=lambda signal: signal.start):
            if signal.start >= 16 and not signal.name.startswith("reserved"):
                frame = name.split("_", 1)[1].lower()
                other = frame if frame.endswith(signal.name) else f"{frame}_{signal.name}"
                column = other if signal.name in taken else signal.name
                taken.add(column)
                found.append(((name, signal.name), column + UNITS.get(signal.unit or "", ""), float(signal.scale)))
    return found


@lru_cache(maxsize=32)
def output_columns(system: str) -> dict[str, str]:
    """Column -> unit of the words that drive the outputs of a system, in their order: us of pulses, "" of duties. {}
    for a system without an output, or whose frames do not carry them all."""
    columns, declared = {key: column for key, column, _ in signals(system)}, declarations.system(system)
    carried = {
        part.word.name: columns[dbc.frame_name(declared, frame), part.name]
        for frame in declared.frames
        for part in (frame.half, frame.word)
        if part is not None
    }
    words = declared.output_words
    return {carried[word.name]: word.unit for word in words} if all(word.name in carried for word in words) else {}

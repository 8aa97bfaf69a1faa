"""The shipped tunings as whole parameter tables, and which of them a board's table came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.contract.scenario import calibrated_words, sensor_words
from plumb.errors import UsageError
from plumb.spec import declarations, parameters
from plumb.tuning import quantities


@dataclass(frozen=True)
class Origin:
    """A shipped tuning as a whole table. differing: whole names of the quantities of a board's table that differ from
    it."""

    system: str
    tuning: str
    table: Mapping[str, int]
    differing: tuple[str, ...]


def words_of(name: str, tuning: str | None) -> dict[str, int]:
    """Parameters by name of a shipped tuning of a system: its control part, and what of the link's part goes with it.

    Raises UsageError for an unknown system or tuning.
    """
    system = systems.load(name)
    chosen = tuning or system.DEFAULT_TUNING
    if chosen not in system.TUNINGS:
        raise UsageError(f"{name} has no tuning '{chosen}'; use one of {', '.join(system.TUNINGS)}")
    pins = {"pins": 0} if system.OUTPUTS else {}  # the pins of speed controllers, unless the system names others
    params = quantise(system.TUNINGS[chosen])
    period_us = system.TUNINGS[chosen].period_us
    return {
        **params.values,
        **params.link_words(),
        "period_us": period_us,
        **pins,
        **system.LINK,
        **sensor_words(system, chosen),
        **dict.fromkeys(calibrated_words(name), 0),  # its numbers replace those of a calibration
    }


def table_of(name: str, tuning: str | None) -> dict[str, int]:
    """The same as a whole table: the factory values are the rest. Raises as `words_of`."""
    return {**{row.name: row.default for row in parameters.table()}, **words_of(name, tuning)}


def origin_of(table: Mapping[str, int], recorded: str | None = None) -> Origin:
    """The shipped tuning of the table's system that a table came from: the recorded one, if the system has it and no
    other is equal to the table; otherwise the one with the fewest differences, of several the system's default."""
    name = declarations.name_of(table["system"])
    system = systems.load(name)
    order = [system.DEFAULT_TUNING, *(tuning for tuning in system.TUNINGS if tuning != system.DEFAULT_TUNING)]
    found = [_compared(name, tuning, table) for tuning in order]
    nearest = min(found, key=lambda origin: len(origin.differing))
    return next((one for one in found if one.tuning == recorded and nearest.differing), nearest)


def _compared(name: str, tuning: str, table: Mapping[str, int]) -> Origin:
    shipped = table_of(name, tuning)
    return Origin(name, tuning, shipped, tuple(quantities.differing(table, shipped)))

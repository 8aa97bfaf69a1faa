"""Settings of a system's tuning by name: which ones a result sets, and how a user applies them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import TypeVar

from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.spec.tuning import AnyTuning
from plumb.systems import load

T = TypeVar("T")
BOARDS = "B: serial:PORT or can:BUS."
DIGITS = 5
"""Significant digits of a setting: finer than the 0.1 % to which its integer holds it."""


def named_tuning(system: str, name: str | None) -> tuple[str, AnyTuning]:
    """A shipped tuning and its name; None: the system's default. Raises UsageError for an unknown system or tuning."""
    part = load(system)
    chosen = name or part.DEFAULT_TUNING
    if chosen not in part.TUNINGS:
        raise UsageError(f"{system} has no tuning '{chosen}'; it has {', '.join(part.TUNINGS)}")
    return chosen, part.TUNINGS[chosen]


def numbers(settings: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Whole name and value of every number of a tuning."""
    if not is_dataclass(settings):
        return
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if is_dataclass(value):
            yield from numbers(value, f"{path}{entry.name}.")
        elif isinstance(value, int | float):
            yield path + entry.name, float(value)


def named(tuning: AnyTuning, values: Mapping[str, float]) -> dict[str, float]:
    """Whole names, as `kalman.q_angle_deg2_per_s`, of every setting whose last name is given, with the value rounded to
    what a person types."""
    found = {}
    for name, _ in numbers(tuning):
        last = name.rpartition(".")[2]
        if last in values:
            found[name] = float(f"{values[last]:.{DIGITS}g}")
    return found


def changed(settings: T, values: Mapping[str, float], path: str = "") -> T:
    """The tuning with these settings, by whole name."""
    assert is_dataclass(settings) and not isinstance(settings, type)
    new: dict[str, object] = {}
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if is_dataclass(value):
            new[entry.name] = changed(value, values, f"{path}{entry.name}.")
        elif path + entry.name in values:
            new[entry.name] = values[path + entry.name]
    return replace(settings, **new)


def refusal(tuning: AnyTuning) -> str:
    """Why the board's integers cannot hold a tuning; "" if they can."""
    try:
        quantise(tuning)
    except UsageError as error:
        return str(error)
    return ""


def apply_lines(values: Mapping[str, float]) -> list[str]:
    """How a user gives these settings to a board, on the command line and in Python."""
    assigned = " ".join(f"{name}={value:.{DIGITS}g}" for name, value in values.items())
    python = ", ".join(f'"{name}": {value:.{DIGITS}g}' for name, value in values.items())
    return [f"plumb params set {assigned} --board B", f"board.params.update({{{python}}})  # of plumb.connect(B)"]

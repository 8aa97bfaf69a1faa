"""Integers of settings: the nearest one within 0.1 %, or a refusal that says what the setting may be."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, NoReturn

from plumb.errors import SettingError, UsageError
from plumb.spec.tuning import AnyTuning

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

TOLERANCE = Fraction(1, 1000)


def refuse(name: str, asked: float, reason: str, least: float = -math.inf, most: float = math.inf) -> NoReturn:
    """Raises SettingError that names the setting, its value, the reason, and what the setting may be."""
    raise SettingError(f"{name} = {asked:g}: {reason}", name, asked, least, most)


def whole(name: str, asked: float, exact: Fraction, low: int, high: int, power: int = 1) -> int:
    """The integer nearest to `exact`, which is the setting `asked`, to this power, in the unit of the integer.

    Raises SettingError if it is outside low to high, or more than 0.1 % off.
    """
    nearest = min(max(round(exact), low), high)
    if abs(nearest - exact) <= abs(exact) * TOLERANCE:
        return nearest
    if not exact:
        refuse(name, asked, "give more than 0", 0.0, math.inf)

    def setting(word: int) -> float:
        """The setting of an integer."""
        there = Fraction(asked) ** power * word / exact
        return float(there) if power == 1 else math.sqrt(there)

    least, most = sorted((setting(low), setting(high)))
    if exact > high:
        refuse(name, asked, f"too large for its integer, the most is {setting(high):.6g}", least, most)
    if exact < low and low != 1:
        refuse(name, asked, f"too small for its integer, the least is {setting(low):.6g}", least, most)
    coarse = math.copysign(setting(round(math.copysign(500, exact))), asked)
    least, most = (coarse, most) if asked > 0 else (least, coarse)
    refuse(name, asked, f"too fine for its integer: ask for at least {abs(coarse):.3g}", least, most)


def _numbers(settings: DataclassInstance, path: str = "") -> Iterator[tuple[str, float]]:
    """Name and value of every field declared as a number. The other fields are choices, checked where they are used."""
    for entry in fields(settings):
        value = getattr(settings, entry.name)
        if is_dataclass(value) and not isinstance(value, type):
            yield from _numbers(value, f"{path}{entry.name}.")
        elif entry.type not in ("int", "float", int, float):
            continue
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield path + entry.name, value
        else:
            raise UsageError(f"{path}{entry.name} is {value!r}: give a number")


def check_numbers(tuning: AnyTuning) -> None:
    """Raises UsageError unless every number is finite and the period is a whole number from 500 to 100000 us."""
    for name, value in _numbers(tuning):
        if not math.isfinite(value):
            raise SettingError(f"{name} is {value}: give a finite number", name, value, -math.inf, math.inf)
    if not 500 <= tuning.period_us <= 100_000 or tuning.period_us != int(tuning.period_us):
        refuse("period_us", tuning.period_us, "periods are whole, from 500 (2 kHz) to 100000 (10 Hz)", 500, 1e5)


def not_negative(values: dict[str, float]) -> None:
    """Raises UsageError for the first value below 0."""
    for name, value in values.items():
        if value < 0:
            refuse(name, value, "it cannot be negative", 0.0, math.inf)

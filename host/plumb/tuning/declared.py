"""Quantise the settings that a system declares (`plumb.spec.settings`), and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from fractions import Fraction
from functools import cache
from operator import attrgetter
from typing import TypeVar, get_type_hints

from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.spec import declarations, parameters
from plumb.spec.parameters import Parameter
from plumb.spec.settings import (
    CHOICE,
    CONSTANTS,
    FILTER,
    SINE,
    STEPS,
    WORD,
    Names,
    Setting,
    bits,
    from_number,
    power,
    to_number,
)
from plumb.spec.tuning import AnyTuning
from plumb.tuning.whole import check_numbers, refuse, whole

Group = TypeVar("Group")
NOTHING: Mapping[str, float] = {}


SHARED = "*"
"""In place of a system: the groups that systems share."""


@cache
def _rows(system: str) -> tuple[tuple[Parameter, Setting], ...]:
    """The system's own parameters that have a setting."""
    rows = declarations.shared()["parameter"] if system == SHARED else declarations.system(system).parameters
    own = {row["name"] for row in rows}
    return tuple((row, row.setting) for row in parameters.table() if row.setting and row.name in own)


def setting_words(tuning: AnyTuning, names: Names = NOTHING) -> dict[str, int]:
    """The words of the parameters with a setting. names: constants of formulas besides those that all have.

    Raises UsageError with the setting, its value and the limit.
    """
    check_numbers(tuning)
    known = {**CONSTANTS, "dt": Fraction(int(tuning.period_us), 10**6), **names}
    return {
        row.name: setting_word(row, setting, attrgetter(setting.name)(tuning), known)
        for row, setting in _rows(tuning.system)
    }


@cache
def shared_settings(group: str) -> tuple[tuple[Parameter, Setting], ...]:
    """The parameters of a shared group that have a setting."""
    return tuple((row, setting) for row, setting in _rows(SHARED) if setting.group == group)


def group_words(group: str, settings: object, names: Names) -> dict[str, int]:
    """The words of a shared group of settings. names: constants of its formulas besides those that all have."""
    known, place = {**CONSTANTS, **names}, len(group) + 1
    return {
        row.name: setting_word(row, setting, float(getattr(settings, setting.name[place:])), known)
        for row, setting in shared_settings(group)
    }


def setting_word(row: Parameter, setting: Setting, asked: float | str, names: Names) -> int:
    """The integer of one setting, within the range of its parameter."""
    if setting.conversion == WORD:
        if asked not in setting.choices:
            raise UsageError(f"{setting.name} = '{asked}': {', '.join(setting.choices)}")
        return setting.choices.index(str(asked))
    assert not isinstance(asked, str)
    name, conversion, scale = setting.name, setting.conversion, 1 << bits(row.format)
    low, high = setting.limits(row.min, row.max)
    if conversion == CHOICE:
        if asked not in range(low, high + 1):
            refuse(name, asked, " or ".join(map(str, range(low, high + 1))), low, high)
        return int(asked)
    if asked < 0 <= low:
        refuse(name, asked, "it cannot be negative", 0.0)
    exact = to_number(conversion, asked, names) * scale
    if conversion in (STEPS, SINE, FILTER):
        return _bent(row, setting, asked, exact, names)
    exact = min(exact, Fraction(high)) if setting.saturates else exact
    return whole(name, asked, exact, low, high, power(conversion))


def _bent(row: Parameter, setting: Setting, asked: float, exact: Fraction, names: Names) -> int:
    """The integer of a setting that is not proportional to it: its limits are those of the integers, converted. A share
    of less than 500 would be more than 0.1 % off."""
    low, high = setting.limits(row.min, row.max)
    fine = max(low, 500) if setting.conversion == FILTER else low
    at_low, at_high = (from_number(setting.conversion, _number(row, word), names) for word in (fine, high))
    if setting.conversion == STEPS:
        if not low <= exact <= high:
            refuse(setting.name, asked, f"{low} to {high} steps", at_low, at_high)
        return int(exact)
    least, most = sorted((at_low, at_high))
    if not least <= asked <= most:
        refuse(setting.name, asked, f"{least:.4g} to {most:.4g} {setting.unit}", least, most)
    return min(max(round(exact), low), high)


def _number(row: Parameter, word: int) -> float:
    """The number that a word stands for. The largest of Q31 in a word with a sign stands for 1."""
    scale = 1 << bits(row.format)
    return 1.0 if row.format == "Q31" and word == scale - 1 else word / scale


def settings_of(
    kind: type[Group],
    params: ControlParams,
    path: str,
    names: Names = NOTHING,
    own: Mapping[str, float] = NOTHING,
    system: str = "",
) -> Group:
    """A group of settings that the words represent, with the groups in it. path: its name in the tuning; own: values of
    the settings without a conversion, by their whole names; system: that declares the group, "" for that in use."""
    known = {**CONSTANTS, "dt": params.period_s, **names}
    rows = {setting.name: (row, setting) for row, setting in _rows(system or params.system)}
    values: dict[str, object] = {}
    hints = get_type_hints(kind)
    assert is_dataclass(kind)
    for entry in fields(kind):
        name, inner = f"{path}.{entry.name}", hints[entry.name]
        if is_dataclass(inner) and isinstance(inner, type):
            values[entry.name] = settings_of(inner, params, name, names, own, system)
        elif name in own:
            values[entry.name] = own[name]
        else:
            row, setting = rows[name]
            word = params[row.name]
            if setting.conversion == WORD:
                values[entry.name] = setting.choices[word]
                continue
            value = from_number(setting.conversion, _number(row, word), known)
            values[entry.name] = word if setting.conversion == CHOICE else value
    return kind(**values)

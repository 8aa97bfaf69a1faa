"""The parameter table in engineering units, by the names of a system's tuning.

A quantity is one field of the tuning (`pid.kp_per_deg`, with the unit and meaning of its `plumb.spec.tuning.quantity`)
or one parameter of the link (`arm_hold_ms`). The functions take a whole table of integers by name, as a board has it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from plumb.contract.parameters import NOTHING, ControlParams, dequantise, quantise
from plumb.errors import UsageError
from plumb.spec import parameters
from plumb.spec.parameters import Parameter
from plumb.spec.tuning import CHOICE, NUMBER, AnyTuning, ForOnePeriod, Quantity
from plumb.tuning.variances import from_turn2_q56, lsb_of

Value = float | int | str

LARGEST = 1 << 64
"""More than any integer parameter holds."""
SHOWN = 80
"""Characters of a value that an error message repeats."""
NUDGE = 1.07
"""A value times this has other integers, whatever its resolution."""
TWICE_ROUNDED = 2e-3
"""Largest relative distance of one quantity in two tables: each rounds by 0.1 %."""


@dataclass(frozen=True)
class NamedQuantity:
    """One quantity.

    name: whole, with the unit (`pid.kp_per_deg`). alias: the same without it, where that is clear (`pid.kp`). unit: of
    the value, CHOICE, or NUMBER. meaning: a phrase. whole_number: integers only. choices: the names to choose from; a
    choice of the link has numbers, which its meaning explains. also: another name.
    """

    name: str
    alias: str
    unit: str
    meaning: str
    whole_number: bool = False
    choices: tuple[str, ...] = ()
    also: str = ""


# ---- what there is ----


@dataclass(frozen=True)
class _Field:
    """A number or a choice of a tuning, however deep. path: its name."""

    path: str
    unit: str
    meaning: str
    type: object
    also: str


def _fields(kind: type, path: str = "", unit: str = "", meaning: str = "") -> Iterator[_Field]:
    """Every field of a tuning class, those of its groups in their place. Raises UsageError for one without
    `quantity`."""
    types = get_type_hints(kind)
    for entry in fields(kind):
        of_a_run = not path or issubclass(kind, ForOnePeriod)  # a tuning may hold that of a system it stands on
        if entry.name == "exact_period_s" or (of_a_run and entry.name == "period_us"):
            continue  # period_us is the link's
        inner = types[entry.name]
        said = entry.metadata.get("quantity", Quantity("", "") if is_dataclass(inner) else None)
        if not isinstance(said, Quantity):
            raise UsageError(
                f"{entry.name} of {kind.__module__}.{kind.__name__} has no unit and meaning: "
                'write field(metadata=quantity("UNIT", "MEANING"))'
            )
        own_unit = " ".join(unit or "unit" if part == "unit" else part for part in said.unit.split())
        own_meaning = ": ".join(filter(None, (meaning, said.meaning)))
        if isinstance(inner, type) and is_dataclass(inner):
            yield from _fields(inner, f"{path}{entry.name}.", own_unit, own_meaning)
        else:
            yield _Field(path + entry.name, own_unit, own_meaning, inner, said.also)


_ENDS = re.findall(
    r"\w+",
    "per_deg_s deg2_per_s dps2_per_s deg_per_mps deg_per_m deg_per_g per_deg per_dps per_s "
    "counts deg2 dps2 mps dps deg us s m",
)
"""Units as names of fields end in them; the first that fits is left out of the alias."""


def _short(path: str, unit: str) -> str:
    """The name without the unit at its end: `pid.kp_per_deg` -> `pid.kp`; `calibration.gyro.unit_per_count` stays."""
    head, dot, last = path.rpartition(".")
    for end in _ENDS:
        if unit not in (CHOICE, NUMBER) and last.endswith(f"_{end}") and last != f"unit_{end}":
            return head + dot + last.removesuffix(f"_{end}")
    return path


@cache
def quantities_of_type(kind: type) -> dict[str, NamedQuantity]:
    """Whole name -> quantity of a tuning class, then those of the link."""
    found = list(_fields(kind))
    short = [_short(one.path, one.unit) for one in found]
    names = {one.path for one in found}
    result = {}
    for one, alias in zip(found, short, strict=True):
        choices = tuple(str(choice) for choice in get_args(one.type)) if get_origin(one.type) is Literal else ()
        clear = short.count(alias) == 1 and alias not in names
        result[one.path] = NamedQuantity(
            one.path, alias if clear else one.path, one.unit, one.meaning, one.type is int, choices, one.also
        )
    for row in _link_rows():
        unit = CHOICE if row.format == "choice" else row.unit or NUMBER
        result[row.name] = NamedQuantity(row.name, row.name, unit, row.doc, whole_number=True)
    return result


def link_row(name: str) -> Parameter | None:
    """The row of a quantity that is a parameter of the link; None for one of the tuning."""
    return next((row for row in _link_rows() if row.name == name), None)


@cache
def _link_rows() -> tuple[Parameter, ...]:
    """Those that have a name of their own: not the unit of variance, which goes with the set."""
    return tuple(row for row in parameters.table() if row.owner == "link" and row.name != parameters.UNIT)


# ---- from a table ----


def control_of(table: Mapping[str, int]) -> ControlParams:
    """The control part of a table with its unit of variance; raises UsageError if the table does not say it."""
    words = [table[row.name] for row in parameters.table() if row.owner == "control"]
    beside = from_turn2_q56(table[parameters.UNIT])
    if beside is NOTHING and any(row.unit.endswith("lsb") for row in own_rows(ControlParams.from_words(words))):
        raise UsageError(
            "the board's parameters do not say their unit of variance: commit one with `plumb params tuning`"
        )
    return ControlParams.from_words(words, beside)


def own_rows(params: ControlParams) -> list[Parameter]:
    """The rows that the system reads."""
    own = params.own()
    return [row for row in parameters.table() if row.name in own]


def tuning_of(table: Mapping[str, int]) -> AnyTuning:
    """The tuning in engineering units that a table holds. Raises UsageError for integers that stand for none."""
    params = control_of(table)
    try:
        return dequantise(params)
    except (ArithmeticError, ValueError) as error:
        raise UsageError(
            f"the integers of {params.system} stand for no tuning in units ({error}): `plumb params list --raw` shows "
            f"them, `plumb params tuning {params.system}` commits others"
        ) from None


def quantities_of(table: Mapping[str, int]) -> dict[str, NamedQuantity]:
    """Whole name -> quantity, of the system that the table is for."""
    return quantities_of_type(type(tuning_of(table)))


def values_of(table: Mapping[str, int]) -> dict[str, Value]:
    """Whole name -> value in the quantity's unit."""
    tuning = tuning_of(table)
    names = quantities_of_type(type(tuning))
    return {name: table[name] if link_row(name) else value_in(tuning, name) for name in names}


def value_in(tuning: AnyTuning, name: str) -> Value:
    """One field of a tuning by its whole name."""
    value: Any = tuning  # Any: a dataclass of any system's tuning, then its field
    for part in name.split("."):
        value = getattr(value, part)
    assert isinstance(value, float | int | str)
    return value


def with_value(tuning: Any, path: str, value: Value) -> Any:  # Any: a dataclass of any system's tuning
    """The tuning with one field replaced, by its whole name."""
    head, _, rest = path.partition(".")
    inner = with_value(getattr(tuning, head), rest, value) if rest else value
    return replace(tuning, **{head: inner})


def differing(table: Mapping[str, int], other: Mapping[str, int]) -> list[str]:
    """Whole names of the quantities that are not the same in two tables of one system.

    A quantity that scales others (the period, a variance, the largest lean) rounds them anew: beside a difference of
    more than TWICE_ROUNDED, smaller ones are left out.
    """
    here, there = values_of(table), values_of(other)
    exact = [name for name in here if here[name] != there[name]]
    return [name for name in exact if not _near(here[name], there[name])] or exact


def _near(a: Value, b: Value) -> bool:
    if isinstance(a, str) or isinstance(b, str):
        return False
    return abs(a - b) <= TWICE_ROUNDED * max(abs(a), abs(b))


# ---- names ----


def find(name: str, names: Mapping[str, NamedQuantity]) -> NamedQuantity:
    """The quantity of a whole name, an alias, another name, or the end of one that is unique (`gyro.zero`, `kp`).

    Raises UsageError with the nearest names.
    """
    if not isinstance(name, str):
        raise UsageError(f"there is no parameter {name!r:.40}: a name is a text, such as pid.kp")
    if name in names:
        return names[name]
    for one in names.values():
        if name and name in (one.alias, one.also):
            return one
    tails = [one for one in names.values() if name and _ends_in(one, name)]
    if len(tails) == 1:
        return tails[0]
    shown = name if name.isprintable() else ascii(name)[1:-1]  # a file's name controls no terminal
    raise UsageError(f"there is no parameter '{shown:.{SHOWN}}' in units; {_hint(name, names, tails)}")


def _ends_in(quantity: NamedQuantity, name: str) -> bool:
    return any(whole.endswith(f".{name}") for whole in (quantity.name, _short(quantity.name, quantity.unit)))


def _hint(name: str, names: Mapping[str, NamedQuantity], tails: list[NamedQuantity]) -> str:
    spelt = (one for quantity in names.values() for one in (quantity.alias, quantity.name, quantity.also) if one)
    every = list(dict.fromkeys(spelt))
    near = [one.alias for one in tails] or [one for one in every if name and name in one]
    near = (near or difflib.get_close_matches(name, every, 3, 0.5))[:3]
    hint = f"did you mean {' or '.join(near)}?" if near else "`plumb params list` or list(board.params) names them all"
    row = next((row for row in parameters.table() if name in (row.name, *row.was)), None)
    if row is None:
        return hint
    return f"{row.name} is an integer of the table, which --raw and board.params.words show; {hint}"


# ---- changes ----


def parsed(quantity: NamedQuantity, text: str) -> Value:
    """The value that a person typed, in the quantity's unit; raises UsageError for a text that is none."""
    text = text.strip()
    if quantity.choices:
        if text not in quantity.choices:
            raise UsageError(f"{quantity.alias} = '{text:.{SHOWN}}': give {' or '.join(quantity.choices)}")
        return text
    try:
        if quantity.whole_number:
            return int(text, 0)
        return float(text)
    except ValueError:
        unit = "" if quantity.unit in (CHOICE, NUMBER) else f" in {quantity.unit}"
        kind = "a whole number" if quantity.whole_number else "a number"
        raise UsageError(f"{quantity.alias} = '{text:.{SHOWN}}': give {kind}{unit}") from None


def assignments(texts: Iterable[str], table: Mapping[str, int]) -> dict[str, Value]:
    """NAME=VALUE texts in units: whole name -> value. Raises UsageError for a text that is not one, and an unknown
    name."""
    names = quantities_of(table)
    result: dict[str, Value] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise UsageError(f"'{text:.{SHOWN}}' sets nothing; write NAME=VALUE, for example pid.kp=0.05")
        one = find(name.strip(), names)
        if one.name in result:
            raise UsageError(f"{one.alias} is set twice; say it once")
        result[one.name] = parsed(one, value)
    return result


def changed(table: Mapping[str, int], wanted: Mapping[str, Value]) -> dict[str, int]:
    """The whole table with other values, by their whole names. Only integers that a change moves differ from the
    table's. Raises UsageError for a value that cannot be."""
    params, before = control_of(table), tuning_of(table)
    names = quantities_of_type(type(before))
    after = before
    link: dict[str, int] = {}
    for name, value in wanted.items():
        _check_kind(names[name], value)
        row = link_row(name)
        if row is not None:
            if isinstance(value, str) or not float(value).is_integer():
                raise UsageError(f"{name} = {value}: give a whole number")
            parameters.check_range(row, int(value))
            link[name] = int(value)
        else:
            after = with_value(after, name, value)
    if "period_us" in link:
        after = replace(after, period_us=link["period_us"], exact_period_s=None)
    new = {**table, **link}
    return new if after == before else {**new, **_requantised(params, before, after)}


def _check_kind(quantity: NamedQuantity, value: Value) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(f"{quantity.name} = {value!r:.40}: give a number, or the name of a choice")
    if isinstance(value, int) and abs(value) > LARGEST:
        raise UsageError(f"{quantity.name}: no parameter is as large as a number of {value.bit_length()} bits")
    if isinstance(value, str) is not bool(quantity.choices):
        wanted = f"give {' or '.join(quantity.choices)}" if quantity.choices else "give a number"
        raise UsageError(f"{quantity.name} = {value!r:.40}: {wanted}")


def _requantised(params: ControlParams, before: AnyTuning, after: AnyTuning) -> dict[str, int]:
    """The words of a changed tuning: only those that the change moves, so that rounding twice moves no others.
    Variances are counted in a unit of the whole set, and go together."""
    old, new = quantise(before), quantise(after)
    moved = {name for name, value in new.own().items() if old.own()[name] != value}
    of_variance = {row.name for row in own_rows(new) if row.unit.endswith("lsb")}
    if old.own() == params.own() or moved & of_variance:
        return {**new.own(), **new.link_words()}
    return {name: new[name] for name in moved}


# ---- which integers hold a quantity ----


def rows_of(name: str, table: Mapping[str, int]) -> list[Parameter]:
    """The rows of the table that hold a quantity: those whose meaning moves with it."""
    row = link_row(name)
    if row is not None:
        return [row]
    tuning = tuning_of(table)
    quantity, value = quantities_of_type(type(tuning))[name], value_in(tuning, name)
    old = quantise(tuning)
    for other in _others(quantity, value):
        try:
            new = quantise(with_value(tuning, name, other))
        except UsageError:
            continue
        moved = [row for row in own_rows(new) if _moves(row, old, new)]
        if moved:
            return moved
    return []


def _others(quantity: NamedQuantity, value: Value) -> list[Value]:
    if isinstance(value, str):
        return [choice for choice in quantity.choices if choice != value]
    if isinstance(value, int):
        return [value - 1, value + 1]
    return [value * NUDGE, value / NUDGE, value * 0.5, 1.0, 0.1, 1e-3, 1e-4]


def _moves(row: Parameter, old: ControlParams, new: ControlParams) -> bool:
    """Whether a word means something else; two words of one integer move together. Variances count in the unit of their
    set, and rounding moves them by less than 2 %."""
    a, b = _whole(row.name, old), _whole(row.name, new)
    if row.unit.endswith("lsb"):
        a, b = a * lsb_of(old), b * lsb_of(new)
        return abs(a - b) > 0.02 * max(abs(a), abs(b))
    return a != b


def _whole(name: str, params: ControlParams) -> float:
    """The integer that a word is of: of 64 bits for a high and a low word, with its fraction where it has one."""
    for end in ("_hi", "_lo"):
        stem = name.removesuffix(end)
        if stem != name:
            return float(params.wide(f"{stem}_hi", f"{stem}_lo"))
    stem = name.removesuffix("_frac_q30")
    fraction = params.values.get(f"{stem}_frac_q30", 0)
    return params[stem] + fraction / 2.0**30

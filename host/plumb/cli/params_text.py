"""Texts of `plumb params`: quantities in units, or with --raw the integers of the table."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

from plumb.errors import UsageError, counted
from plumb.spec import parameters
from plumb.spec.parameters import Parameter
from plumb.spec.tuning import CHOICE, NUMBER
from plumb.spec.units import Meaning, meaning
from plumb.tuning import quantities
from plumb.tuning.quantities import NamedQuantity, Value

if TYPE_CHECKING:
    from plumb.api.parameters import ParameterDescription
    from plumb.systems.shipped_tunings import Origin


# ---- quantities ----


class Listed(TypedDict):
    """One quantity in `params list --json`. choice: the meaning of a number that is a choice."""

    name: str
    alias: str
    value: Value
    unit: str
    choice: str
    meaning: str
    tuning_value: Value
    differs: bool


def value_text(value: Value, quantity: NamedQuantity, table: Mapping[str, int]) -> str:
    """The value as it is printed, without its unit; a choice of the link with its name, without its explanation."""
    if isinstance(value, float):
        return f"{value:z.6g}"
    said = choice_of(quantity, table).partition(" (")[0]
    return f"{value} = {said}" if said else str(value)


def with_unit(text: str, quantity: NamedQuantity) -> str:
    """The same with its unit; a choice and a pure number have none to print."""
    return text if quantity.unit in (CHOICE, NUMBER) else f"{text} {quantity.unit}"


def choice_of(quantity: NamedQuantity, table: Mapping[str, int]) -> str:
    """The name of a choice that the table holds as a number; "" for other quantities."""
    row = quantities.link_row(quantity.name)
    return meaning(row, table).choice if row is not None else ""


def listed(table: Mapping[str, int], origin: Origin) -> list[Listed]:
    """Every quantity, in the order of the data flow."""
    names = quantities.quantities_of(table)
    values, shipped = quantities.values_of(table), quantities.values_of(origin.table)
    return [
        {
            "name": name,
            "alias": one.alias,
            "value": values[name],
            "unit": one.unit,
            "choice": choice_of(one, table),
            "meaning": one.meaning,
            "tuning_value": shipped[name],
            "differs": name in origin.differing,
        }
        for name, one in names.items()
    ]


def matching(pattern: str | None, entries: Sequence[Listed]) -> list[Listed]:
    """Entries whose name or meaning contains the text, in any case, or whose name a pattern with * or ? matches.

    Raises UsageError if none does.
    """
    if pattern is None:
        return list(entries)
    wanted = pattern.lower()
    if any(sign in wanted for sign in "*?["):
        found = [one for one in entries if any(fnmatch.fnmatchcase(one[key], wanted) for key in ("name", "alias"))]
    else:
        found = [one for one in entries if wanted in f"{one['name']} {one['alias']} {one['meaning']}".lower()]
    if not found:
        raise UsageError(f"no parameter has '{pattern:.80}' in its name or meaning; `plumb params list` shows them all")
    return found


def listing(entries: Sequence[Listed], origin: Origin, table: Mapping[str, int]) -> str:
    """One line for each quantity; a star and the tuning's value where it differs from the tuning it came from."""
    names = quantities.quantities_of(table)
    count = len(origin.differing)
    differ = f"{counted(count, 'parameter differs', 'parameters differ')} (*)" if count else "nothing differs"
    lines = [["  name", "value", "unit", "tuning", "meaning"]]
    for entry in entries:
        quantity = names[entry["name"]]
        star = "* " if entry["differs"] else "  "
        was = value_text(entry["tuning_value"], quantity, origin.table) if entry["differs"] else ""
        now = value_text(entry["value"], quantity, table)
        lines.append([star + entry["alias"], now, entry["unit"], was, entry["meaning"]])
    return f"{origin.system}, from its tuning '{origin.tuning}': {differ}\n{columns(lines)}"


def described(about: ParameterDescription) -> dict[str, object]:
    """One quantity in `params get --json`; null for a limit that there is not."""
    limits = {key: limit if limit is None or math.isfinite(limit) else None for key, limit in
              (("min", about.min), ("max", about.max))}  # fmt: skip
    return {
        "name": about.name,
        "alias": about.alias,
        "value": about.value,
        "unit": about.unit,
        "meaning": about.meaning,
        **limits,
        "words": list(about.words),
    }


def in_units(about: ParameterDescription, table: Mapping[str, int]) -> str:
    """One quantity with its meaning, its limits while the others are as they are, and the integers that hold it."""
    quantity = quantities.quantities_of(table)[about.name]
    held = ", ".join(f"{name} = {table[name]}" for name in about.words)
    said = with_unit(value_text(about.value, quantity, table), quantity)
    bounds = " or ".join(quantity.choices)
    if about.min is not None and about.max is not None:
        bounds = with_unit(f"{about.min:z.6g} .. {about.max:z.6g}", quantity)
    also = f" (also {about.name})" if about.alias != about.name else ""
    return f"{about.alias} = {said}{also}\n  {about.meaning}\n  {bounds}\n  held by {held}"


def _differing(before: Mapping[str, int], after: Mapping[str, int]) -> list[str] | None:
    """Whole names of the quantities that a change moved; None if the tables are of two systems or one stands for no
    tuning."""
    if before["system"] != after["system"]:
        return None
    try:
        return quantities.differing(before, after)
    except UsageError:
        return None


def changes(before: Mapping[str, int], after: Mapping[str, int]) -> dict[str, dict[str, Value]]:
    """Alias -> value before and after, and the unit, of every quantity that differs; nothing if there are no units to
    compare in."""
    found = _differing(before, after)
    if not found:
        return {}
    names, was, now = quantities.quantities_of(after), quantities.values_of(before), quantities.values_of(after)
    return {names[name].alias: {"from": was[name], "to": now[name], "unit": names[name].unit} for name in found}


def change_lines(before: Mapping[str, int], after: Mapping[str, int]) -> list[str]:
    """The same as lines to print; of another system its name alone, and integers where there are no units."""
    found = _differing(before, after)
    if found is None:
        lines = raw_change_lines(before, after)
        return lines[:1] if before["system"] != after["system"] else lines
    names, was, now = quantities.quantities_of(after), quantities.values_of(before), quantities.values_of(after)
    return [
        f"{names[name].alias}: {value_text(was[name], names[name], before)} -> "
        + with_unit(value_text(now[name], names[name], after), names[name])
        for name in found
    ]


# ---- integers ----


_DECLARED = ("name", "owner", "type", "unit", "format", "min", "max", "default", "doc")
"""Entries of the declaration in `params list --raw --json`."""


@dataclass(frozen=True)
class RawEntry:
    """One parameter: its declaration, its integer, and what the integer means in engineering units."""

    row: Parameter
    value: int
    means: Meaning

    def to_json(self) -> dict[str, object]:
        """As `params list --raw --json` prints it."""
        return {name: getattr(self.row, name) for name in _DECLARED} | {
            "value": self.value,
            "meaning": self.means.choice or self.means.value,
            "meaning_unit": self.means.unit,
            "meaning_text": str(self.means),
        }


def raw_entry(row: Parameter, values: Mapping[str, int]) -> RawEntry:
    """One parameter of a table of integers."""
    return RawEntry(row, values[row.name], meaning(row, values))


def raw_rows(pattern: str | None) -> tuple[Parameter, ...]:
    """The rows whose name or description contains the text; all without one. Raises UsageError if none does."""
    rows = parameters.table()
    if pattern is None:
        return rows
    found = tuple(row for row in rows if pattern.lower() in f"{row.name} {row.doc}".lower())
    if not found:
        raise UsageError(f"no integer has '{pattern:.80}' in its name or meaning; `plumb params list --raw` shows them")
    return found


def raw_listing(entries: Iterable[RawEntry]) -> str:
    """One line for each integer, with a star if it differs from the default."""
    lines = [["  name", "value", "meaning", "unit, format", "range", "default"]]
    for entry in entries:
        row = entry.row
        star = "  " if entry.value == row.default else "* "
        kind = ", ".join(filter(None, (row.unit, row.format)))
        bounds = f"{row.min} .. {row.max}"
        lines.append([star + row.name, str(entry.value), str(entry.means), kind, bounds, str(row.default)])
    return columns(lines)


def in_full(entry: RawEntry) -> str:
    """One integer with its description."""
    row = entry.row
    kind = ", ".join(filter(None, (row.type, row.unit, row.format)))
    means = f"  = {entry.means}" if str(entry.means) else ""
    return f"{row.name} = {entry.value}{means}\n  {row.doc}\n  {kind}; {row.min} .. {row.max}, default {row.default}"


def raw_change_lines(before: Mapping[str, int], after: Mapping[str, int]) -> list[str]:
    """A line for every integer that differs."""
    lines = []
    for row in parameters.table():
        if after[row.name] != before[row.name]:
            means = str(meaning(row, after))
            lines.append(f"{row.name}: {before[row.name]} -> {after[row.name]}" + (f" ({means})" if means else ""))
    return lines


def columns(lines: Sequence[Sequence[str]]) -> str:
    """Rows of cells with each column as wide as its widest cell."""
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip() for line in lines)

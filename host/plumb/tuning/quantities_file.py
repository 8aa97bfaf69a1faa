"""A parameter table as a commented TOML file in engineering units, which a person edits.

    system = "SYSTEM"

    pid.kp = 0.045  # 1/deg: proportional gain: command per deg of tilt error
    ...

A file may hold some parameters only; the others stay as they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import input_files, toml_text
from plumb.spec import declarations
from plumb.tuning import quantities
from plumb.tuning.quantities import NamedQuantity, Value

MOST_BYTES = 1 << 20
SYSTEM = "system"
DIGITS = 7
"""Of a value in the file. A value that was not edited is not set, so its integer keeps more of them."""


def text_of(table: Mapping[str, int], title: str) -> str:
    """The text of a file with every quantity of a table. title: the first line, without its mark."""
    names, values = quantities.quantities_of(table), quantities.values_of(table)
    lines = [f"# {title}", f"{SYSTEM} = {json.dumps(declarations.name_of(table['system']))}"]
    group = None
    for name, one in names.items():
        if group != (group := one.alias.rpartition(".")[0]):
            lines.append("")
        choices = f" ({' or '.join(one.choices)})" if one.choices else ""
        lines.append(f"{one.alias} = {_value_text(values[name])}  # {one.unit}: {one.meaning}{choices}")
    return "\n".join(lines) + "\n"


def _value_text(value: Value) -> str:
    if isinstance(value, str):
        return json.dumps(value)
    return str(value) if isinstance(value, int) else _float_text(value)


def _float_text(value: float) -> str:
    text = f"{value:.{DIGITS}g}"
    return text if any(sign in text for sign in ".en") else f"{text}.0"


def wanted(text: str, where: str, table: Mapping[str, int]) -> dict[str, Value]:
    """The quantities of a file that differ from a table, by their whole names. where: the file, for messages.

    Raises UsageError for a text that is no TOML, for one of another system, an unknown name, and a value that is none.
    """
    names = quantities.quantities_of(table)
    system = declarations.name_of(table["system"])
    other = _parsed(text, where).get(SYSTEM, system)
    if other != system:
        raise UsageError(
            f"{where} is for {other!r:.40}, the board is a {system}: `plumb params tuning` makes it another"
        )
    shown = _read(text_of(table, ""), "", names)
    given = _read(text, where, names)
    return {name: value for name, value in given.items() if value != shown[name]}


def is_in_units(path: Path) -> bool:
    """Whether a TOML file is one of these, and no table of integers. Raises UsageError if it cannot be read."""
    said = _parsed(read_text(path), str(path))
    return "values" not in said and any(_flat(said))


def read_text(path: Path) -> str:
    """The text of a file; raises UsageError."""
    return input_files.read_text(path, MOST_BYTES, "give a file of `plumb params dump` or `edit`")


def _parsed(text: str, where: str) -> dict[str, object]:
    try:
        return toml_text.parse(text)
    except ValueError as error:
        raise UsageError(f"{where} is no TOML file ({error}); correct that line") from None


def _read(text: str, where: str, names: Mapping[str, NamedQuantity]) -> dict[str, Value]:
    result: dict[str, Value] = {}
    for name, value in _flat(_parsed(text, where)):
        if name == SYSTEM:
            continue
        try:
            one = quantities.find(name, names)
        except UsageError as error:
            raise UsageError(f"{where}: {error}") from None
        if one.name in result:
            raise UsageError(f"{where}: {one.alias} is there twice; leave one out")
        result[one.name] = _checked(value, one, where)
    return result


def _checked(value: object, one: NamedQuantity, where: str) -> Value:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(f"{where}: {one.alias} is neither a number nor a text")
    return float(value) if type(value) is int and not one.whole_number and abs(value) < quantities.LARGEST else value


def _flat(said: Mapping[str, object], path: str = "") -> Iterator[tuple[str, object]]:
    for name, value in said.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{path}{name}.")
        else:
            yield path + name, value

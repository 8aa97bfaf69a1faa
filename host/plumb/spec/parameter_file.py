"""Parameters as people write them: NAME=VALUE on the command line, and a TOML file with every value of the table.

    crc32 = "0xdd6be592"              # of the whole table the values were taken from

    [values]
    "gyro.raw_min" = 1401
    ...

Values are the integers of parameters.toml.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import input_files, toml_text, whole_files
from plumb.spec import armed_values, declarations, parameters
from plumb.spec.parameters import Parameter
from plumb.spec.units import meaning

MOST_BYTES = 1 << 20
"""Largest file of parameters that is read; `plumb params dump` writes about 10 KiB."""

EXCERPT = 60
"""Characters of a name or a value that an error message repeats."""


def row_named(name: str) -> Parameter:
    """The row of that name; raises UsageError that suggests similar names."""
    names = [row.name for row in parameters.table()]
    if name in names:
        return parameters.table()[names.index(name)]
    if name in parameters.new_names():
        raise UsageError(f"{name} is named {parameters.new_names()[name]} now; use that name")
    near = [other for other in names if name and name in other]
    near = (near or difflib.get_close_matches(name, names, 3, 0.5))[:3]
    hint = f"did you mean {' or '.join(near)}?" if near else "`plumb params list` names them all"
    raise UsageError(f"there is no parameter '{name}'; {hint}")


def _in_range(row: Parameter, value: int) -> int:
    """The value; raises UsageError with the range."""
    if row.min <= value <= row.max:
        return value
    raise UsageError(f"{row.out_of_range(value)}{_counted_in(row)}; nothing was changed")


def _counted_in(row: Parameter) -> str:
    """Q format and unit of a row's integer, in parentheses; "" if it has neither."""
    parts = [row.format] * row.format.startswith("Q") + [f"unit {row.unit}"] * bool(row.unit)
    return f" ({', '.join(parts)})" if parts else ""


def assignments(texts: Iterable[str]) -> dict[str, int]:
    """Parse NAME=VALUE texts; a value is an integer in decimal or 0x... Raises UsageError for a text that is not one,
    for an unknown name, and for a value out of range."""
    result: dict[str, int] = {}
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals:
            raise UsageError(f"'{text}' sets nothing; write NAME=VALUE, for example period_us=10000")
        row = row_named(name.strip())
        try:
            value = int(number, 0)
        except ValueError:
            raise UsageError(f"'{number}' is no integer: {row.name} is an integer{_counted_in(row)}") from None
        if row.name in result:
            raise UsageError(f"{row.name} is set twice; say it once")
        result[row.name] = _in_range(row, value)
    return result


def by_name(words: Sequence[int]) -> dict[str, int]:
    """The words of a table by name, in order; words without a row in this version are left out."""
    return {row.name: word for row, word in zip(parameters.table(), words, strict=False)}


def warnings(values: Mapping[str, int]) -> list[str]:
    """Warnings about settings that the board accepts and that are probably a mistake, one sentence each."""
    system = declarations.name_of(values["system"])
    found = armed_values.unsafe(values)
    unsafe = [f"the board takes this, and is not armed with it: {found.text}"] if found else []
    name, run_us = declarations.system(system).period, values["period_us"]
    filter_us = parameters.period_s(system, values) * 1e6
    if abs(filter_us - run_us) <= 0.001 * run_us:
        return unsafe
    return [
        *unsafe,
        f"a run in real time steps every {run_us} us (period_us), and the filter counts on {filter_us:.6g} us "
        f"({name}): its angles will be wrong",
    ]


def text_of(words: Sequence[int]) -> str:
    """The text of a file with the whole table."""
    values = by_name(words)
    lines = [
        "# Parameters of a plumb board. The values are the integers of its table; what they mean stands beside them.",
        "# `plumb params load` stages and commits this file.",
        "",
        f'crc32 = "0x{parameters.crc32(words):08x}"',
        "",
        "[values]",
    ]
    for row in parameters.table()[: len(values)]:
        means = str(meaning(row, values)) or f"{row.format}, {row.unit}"
        lines.append(f'"{row.name}" = {values[row.name]}  # {means}')
    return "\n".join(lines) + "\n"


def write(path: Path, text: str) -> None:
    """Write the file atomically: after a failure the old file is still there. Raises UsageError if it cannot be
    written."""
    try:
        target = path.resolve()
        if target.exists() and not target.is_file():  # a device or a pipe is written to, never replaced
            target.write_text(text, encoding="utf-8")
            return
        if not target.parent.is_dir():
            raise UsageError(f"cannot write {path}: there is no folder {target.parent}; choose another file")
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}; choose another file") from None
    whole_files.write_whole({target: text}, "choose another file")


@dataclass(frozen=True)
class TableFile:
    """Contents of a parameter file.

    values: the values that have a row in this version's table, checked against its range. renamed: former name ->
    present name, for rows that the file gives under a former name. unknown: names without a row. missing: rows that
    the file lacks. edited: the file holds a whole table whose CRC-32 differs from the stated one.
    """

    values: dict[str, int]
    renamed: dict[str, str]
    unknown: list[str]
    missing: list[str]
    edited: bool


def _excerpt(value: object) -> str:
    """A value of the file for an error message: shortened, and escaped so that it cannot control a terminal."""
    if isinstance(value, list | dict):
        return "a list" if isinstance(value, list) else "a table"
    text = ascii(value)
    return text if len(text) <= EXCERPT else f"{text[:EXCERPT]}..{text[-1]}"


def read(path: Path) -> TableFile:
    """Read a parameter file; raises UsageError if it cannot be read or holds an invalid value."""
    text = input_files.read_text(path, MOST_BYTES, "give a file of `plumb params dump`")
    try:
        said = toml_text.parse(text)
    except ValueError as error:
        raise UsageError(f"{path} is no TOML file ({error}); give a file of `plumb params dump`") from None
    given = said.get("values")
    if not isinstance(given, dict) or not given:
        raise UsageError(f"{path} has no [values]; give a file of `plumb params dump`")
    rows = parameters.table()
    names = {row.name for row in rows}
    renamed = {old: new for old, new in parameters.new_names().items() if old in given}
    for old, new in renamed.items():
        if new in given:
            raise UsageError(f"{path}: {old} is the former name of {new}, which is there, too; leave one out")
    given = {renamed.get(name, name): value for name, value in given.items()}
    values: dict[str, int] = {}
    for row in rows:
        if row.name in given:
            value = given[row.name]
            if type(value) is not int:
                raise UsageError(f"{path}: {row.name} = {_excerpt(value)} is no integer; write a whole number")
            values[row.name] = _in_range(row, value)
    unknown = [_excerpt(name)[1:-1] for name in given if name not in names]
    missing = [row.name for row in rows if row.name not in given]
    crc = said.get("crc32")
    whole = not unknown and not missing
    edited = whole and crc is not None and crc != f"0x{parameters.crc32(list(values.values())):08x}"
    return TableFile(values, renamed, unknown, missing, edited)

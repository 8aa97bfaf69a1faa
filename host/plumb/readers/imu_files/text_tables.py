"""How a text table is written: its encoding, its separator, the line of its header, decimal commas."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from plumb.errors import UsageError
from plumb.readers.imu_files.conventions import conventional
from plumb.readers.imu_files.given import COUNTS, SHOWN, Given
from plumb.readers.imu_files.header_words import UNITS, Meaning, meaning, unit_of

HEADER_LINES = 200
"""Lines in which a header is looked for: loggers put comments before it."""
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}


@dataclass(frozen=True)
class Layout:
    """separator: one character; header: its cells; meanings: by the place of a column; kind: of the file; ref: the
    places of w, x, y, z where a convention has a reference; note: for people."""

    separator: str
    header: list[str]
    meanings: dict[int, Meaning]
    kind: str = "table"
    ref: list[int] = field(default_factory=list)
    note: str = ""


def encoding_of(path: Path) -> str:
    with path.open("rb") as file:
        return "utf-16" if file.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


def layout_of(line: str, given: Given, before: Sequence[str] = ()) -> Layout | None:
    """The layout that a line declares, if it is the header of an IMU: it names a time and three axes of a gyro and of
    an accelerometer. The line may be a comment. before: the lines before it. Raises csv.Error."""
    text = line.strip().lstrip("#/").strip()
    for separator in SEPARATORS:
        header = [cell.strip() for cell in next(csv.reader([text], delimiter=separator), [])]
        meanings = _named(header, given)
        known = conventional(header, before) if not given.columns else None
        if known:
            return Layout(separator, header, known.meanings, known.name, known.ref, known.note)
        seen = {(said.quantity, said.axis) for said in meanings.values()}
        for at, cell in enumerate(header):
            said = meaning(cell)
            if said is not None and (said.quantity, said.axis) not in seen and at not in meanings:
                seen.add((said.quantity, said.axis))
                meanings[at] = said
        if seen == {("time", 0), *((quantity, axis) for quantity in ("gyr", "acc") for axis in range(3))}:
            return Layout(separator, header, meanings)
    return None


def _named(header: list[str], given: Given) -> dict[int, Meaning]:
    """The columns that --columns names, by their places; their headers may state a unit."""
    found = {}
    for quantity, names in given.columns.items():
        for axis, name in enumerate(names):
            if name in header:
                unit = unit_of(name)
                found[header.index(name)] = Meaning(quantity, axis, unit, UNITS[quantity].get(unit))
    return found


def with_units(path: Path, line: int, layout: Layout, given: Given) -> Layout:
    """With the units of --units. Raises UsageError for a column whose unit is not known then."""
    meanings = {
        at: replace(said, unit=given.units[said.quantity], factor=given.factor(said.quantity))
        if said.quantity in given.units
        else said
        for at, said in layout.meanings.items()
    }
    lacking = {said.quantity: at for at, said in reversed(meanings.items()) if said.factor is None}
    for at, said in meanings.items():
        if said.factor is None:
            fault = f"has the unit {said.unit!r}, which is not known" if said.unit else "states no unit"
            option = ",".join(f"{quantity}={SHOWN[quantity][0]}" for quantity in COUNTS if quantity in lacking)
            choices = "; ".join(
                f"{quantity}: {', '.join(SHOWN[quantity])}, or a part of it, as '1/131 deg/s'"
                if quantity == "gyr"
                else f"{quantity}: {', '.join(SHOWN[quantity])}"
                for quantity in COUNTS
                if quantity in lacking
            )
            raise UsageError(
                f'{path.name} line {line}: column {layout.header[at]!r} {fault}; give --units "{option}" ({choices})'
            )
    return replace(layout, meanings=meanings)


def sentences(layout: Layout, line: int, given: Given) -> list[str]:
    """What was taken of a table, for people."""
    found = [f"{layout.kind}, header in line {line}, separator {SEPARATORS[layout.separator]}"]
    for quantity in COUNTS:
        columns = sorted(
            (said.axis, at, said.unit) for at, said in layout.meanings.items() if said.quantity == quantity
        )
        names = ", ".join(repr(layout.header[at]) for _, at, _ in columns)
        by = " by --units" if quantity in given.units else ""
        found.append(f"{quantity} from {names} in {', '.join(dict.fromkeys(unit for *_, unit in columns))}{by}")
    return [*found, layout.note] if layout.note else found


def number(text: str, separator: str) -> float:
    """Raises ValueError. A comma that does not separate is a decimal comma."""
    return float(text.replace(",", ".") if separator != "," else text)

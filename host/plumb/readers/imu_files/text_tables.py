"""How a text table is written: its encoding, its separator, the line of its header, decimal commas."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from plumb.errors import UsageError
from plumb.readers.imu_files.conventions import conventional
from plumb.readers.imu_files.formats import Header
from plumb.readers.imu_files.given import COUNTS, PARTS, SHOWN, Given
from plumb.readers.imu_files.header_words import UNITS, Meaning, meaning, unit_of
from plumb.readers.imu_files.moments import is_moment

HEADER_LINES = 200
"""Lines in which a header is looked for: loggers put comments before it."""
SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab", " ": "space"}
SENSORS = ("gyr", "acc")
MOMENT = "date-time"
"""The unit of stamps that are a date or a time of day."""

HEADERS = (
    Header(
        "x-io: x-IMU, NGIMU, x-IMU3, Fusion",
        "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),"
        "Accelerometer Z (g)",
        "one file or the folder; `Packet number` asks for its rate",
    ),
    Header(
        "phyphox, one table",
        "Time (s),Gyroscope x (rad/s),Gyroscope y (rad/s),Gyroscope z (rad/s),Acceleration x (m/s^2),"
        "Acceleration y (m/s^2),Acceleration z (m/s^2)",
        "the acceleration with gravity",
    ),
    Header(
        "AndroSensor",
        "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);"
        "GYROSCOPE Z (rad/s);Time since start in ms",
    ),
    Header(
        "EuRoC",
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
        "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
    ),
    Header(
        "any table",
        "t_ms,gx_dps,gy_dps,gz_dps,ax_mg,ay_mg,az_mg",
        "or units in the row below; separated by comma, semicolon, tab or spaces; decimal commas; dates or times of "
        "day as stamps; any encoding, or gzip; words in English or German",
    ),
)
"""Headers of known programs, which their words and units explain."""


@dataclass(frozen=True)
class Layout:
    """separator: one character; header: its cells; meanings: by the place of a column; kind: of the file; ref: the
    places of w, x, y, z where a convention has a reference; note: for people; wraps: by the place of a column, the
    count at which it begins again at 0."""

    separator: str
    header: list[str]
    meanings: dict[int, Meaning]
    kind: str = "table"
    ref: list[int] = field(default_factory=list)
    note: str = ""
    wraps: dict[int, float] = field(default_factory=dict)

    @property
    def named(self) -> set[tuple[str, int]]:
        return {(said.quantity, said.axis) for said in self.meanings.values()}


def layout_of(
    line: str, given: Given, before: Sequence[str] = (), wanted: Iterable[str] = SENSORS, bare: str | None = None
) -> Layout | None:
    """The layout that a line declares, if it is the header of an IMU: it names three axes of each quantity of `wanted`.
    The line may be a comment. before: the lines before it; bare: the quantity of columns named by their axis alone.
    Raises csv.Error."""
    for separator in SEPARATORS:
        header = cells(line.strip().lstrip("#/%").strip(), separator)
        if separator == " " and not given.columns and any(one in ("=", ":", "|") or _is_number(one) for one in header):
            continue  # labels with their values
        found = _layout(header, separator, given, before, bare)
        if all((quantity, axis) in found.named for quantity in wanted for axis in range(3)):
            return found
    return None


def named_by(line: str, given: Given, bare: str | None = None) -> list[str]:
    """The quantities of which a line names at least one column, as a header would."""
    best: list[str] = []
    for separator in SEPARATORS:
        found = _layout(cells(line.strip().lstrip("#/%").strip(), separator), separator, given, (), bare)
        names = list(dict.fromkeys(quantity for quantity, _ in found.named))
        best = names if len(names) > len(best) else best
    return best


def cells(line: str, separator: str) -> list[str]:
    """Raises csv.Error."""
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _layout(header: list[str], separator: str, given: Given, before: Sequence[str], bare: str | None) -> Layout:
    meanings = _named(header, given)
    known = conventional(header, before) if not given.columns else None
    if known:
        meanings = {**known.meanings, **_magnetometer(header, known.meanings)}
        return Layout(separator, header, meanings, known.name, known.ref, known.note, known.wraps)
    seen = {(said.quantity, said.axis) for said in meanings.values()}
    times, doubled = [], []
    for at, cell in enumerate(header):
        said = meaning(cell, bare)
        if said is None or at in meanings:
            continue
        if said.quantity == "time":
            times.append((said.factor is None, at, said))
        elif (said.quantity, said.axis) in seen:
            doubled.append(cell)
        else:
            seen.add((said.quantity, said.axis))
            meanings[at] = said
    if times and ("time", 0) not in seen:
        _, at, said = min(times, key=lambda one: one[:2])
        meanings[at] = said
    mag = {at: said for at, said in meanings.items() if said.quantity == "mag"}
    if 0 < len(mag) < 3:
        meanings = {at: said for at, said in meanings.items() if at not in mag}
    names = ", ".join(repr(one) for one in dict.fromkeys(doubled))
    return Layout(
        separator,
        header,
        meanings,
        note=f"more columns of the same name or meaning are left out: {names}" if names else "",
    )


def _magnetometer(header: list[str], taken: dict[int, Meaning]) -> dict[int, Meaning]:
    """Of a table of a known program, whose convention is about the other two sensors: by the words, one column an
    axis."""
    found = {at: said for at, cell in enumerate(header) if at not in taken and (said := meaning(cell))}
    mag = {at: said for at, said in found.items() if said.quantity == "mag"}
    return mag if sorted(said.axis for said in mag.values()) == [0, 1, 2] else {}


def without_empty_time(layout: Layout, row: list[str], given: Given, before: Sequence[str], bare: str | None) -> Layout:
    """The layout without a time that the first row leaves empty, as some loggers do that have another column for it."""
    for at, said in layout.meanings.items():
        if said.quantity == "time" and "time" not in given.columns and at < len(row) and not row[at]:
            header = [*layout.header[:at], "", *layout.header[at + 1 :]]
            return _layout(header, layout.separator, given, before, bare)
    return layout


def with_first_row(layout: Layout, row: list[str], given: Given) -> Layout:
    """With the time that the first row has: a stamp that is a date or a time of day needs no unit."""

    def cell(at: int) -> str:
        return row[at] if at < len(row) else ""

    mine = [at for at, said in layout.meanings.items() if said.quantity == "time"]
    if not mine or "time" in given.columns:
        times = mine
    else:
        times = [*mine, *(at for at, name in enumerate(layout.header) if at not in mine and _is_time(name))]
    for at in times:
        if is_moment(cell(at)) and (layout.meanings[mine[0]].factor is None or not _is_number(cell(mine[0]))):
            meanings = {a: said for a, said in layout.meanings.items() if a not in mine}
            return replace(layout, meanings={**meanings, at: Meaning("time", 0, MOMENT, 1.0)}, wraps={})
    return layout


def _is_time(name: str) -> bool:
    said = meaning(name)
    return said is not None and said.quantity == "time"


def is_value(text: str) -> bool:
    """Whether a cell is a number or a stamp."""
    return _is_number(text) or is_moment(text)


def lacks_header(lines: Sequence[str]) -> bool:
    """Whether the first row of six numbers or more stands below no line of as many cells."""
    above = ""
    for line in lines:
        for separator in SEPARATORS:
            row = cells(line.strip(), separator)
            if len(row) >= 6 and all(is_value(one) for one in row if one):
                return len(cells(above.strip(), separator)) != len(row)
        above = line if line.strip() else above
    return False


def _is_number(text: str) -> bool:
    try:
        number(text, "")
    except ValueError:
        return False
    return True


def with_unit_row(layout: Layout, row: list[str]) -> Layout | None:
    """With the units of a row below the header; None for a row that has none. Units of the header stand above them."""
    units = {}
    for at, said in layout.meanings.items():
        text = row[at].strip().strip("()[]").strip().lower() if at < len(row) else ""
        if _is_number(text):
            return None
        if said.factor is None and text in UNITS[said.quantity]:
            units[at] = replace(said, unit=text, factor=UNITS[said.quantity][text])
    if not any(
        row[at].strip().strip("()[]").strip().lower() in UNITS[said.quantity]
        for at, said in layout.meanings.items()
        if at < len(row) and row[at].strip()
    ):
        return None
    return replace(layout, meanings={**layout.meanings, **units})


def _named(header: list[str], given: Given) -> dict[int, Meaning]:
    """The columns that --columns names, by their places; their headers may state a unit."""
    found = {}
    for quantity, names in given.columns.items():
        for axis, name in enumerate(names):
            if name in header:
                unit = unit_of(name)
                found[header.index(name)] = Meaning(quantity, axis, unit, UNITS[quantity].get(unit))
    return found


def with_units(name: str, line: int, layout: Layout, given: Given) -> Layout:
    """With the units of --units. Raises UsageError for a column whose unit is not known then."""
    meanings = {
        at: replace(said, unit=given.units[said.quantity], factor=given.factor(said.quantity))
        if said.quantity in given.units and said.unit != MOMENT
        else said
        for at, said in layout.meanings.items()
    }
    lacking = {said.quantity: at for at, said in reversed(meanings.items()) if said.factor is None}
    for at, said in meanings.items():
        if said.factor is None:
            fault = f"has the unit {said.unit!r}, which is not known" if said.unit else "states no unit"
            option = ",".join(f"{quantity}={SHOWN[quantity][0]}" for quantity in COUNTS if quantity in lacking)
            choices = "; ".join(
                f"{quantity}: {', '.join(SHOWN[quantity])}, or of one count, as '{PARTS[quantity]}'"
                for quantity in COUNTS
                if quantity in lacking
            )
            raise UsageError(
                f'{name} line {line}: column {layout.header[at]!r} {fault}; give --units "{option}" ({choices})'
            )
    return replace(layout, meanings=meanings)


def sentences(layout: Layout, line: int, given: Given) -> list[str]:
    """What was taken of a table, for people."""
    found = [f"{layout.kind}, header in line {line}, separator {SEPARATORS[layout.separator]}"]
    for quantity in (*COUNTS, "mag"):
        columns = sorted(
            (said.axis, at, said.unit) for at, said in layout.meanings.items() if said.quantity == quantity
        )
        if not columns:
            continue
        names = ", ".join(repr(layout.header[at]) for _, at, _ in columns)
        by = " by --units" if quantity in given.units else ""
        units = ", ".join(dict.fromkeys(unit for *_, unit in columns)) or "a unit that is not stated"
        found.append(f"{quantity} from {names} in {units}{by}")
    return [*found, layout.note] if layout.note else found


def number(text: str, separator: str) -> float:
    """Raises ValueError. A comma that does not separate is a decimal comma."""
    return float(text.replace(",", ".") if separator != "," else text)

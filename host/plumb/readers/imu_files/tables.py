"""Read one table of an IMU: its header, a row of units, its rows, and what stands between them."""

from __future__ import annotations

import csv
import itertools
import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plumb.errors import UsageError
from plumb.readers.imu_files import serial_dumps, text_tables
from plumb.readers.imu_files.given import COLUMNS_EXAMPLE, Given
from plumb.readers.imu_files.moments import Moments
from plumb.readers.imu_files.text_tables import MOMENT, SENSORS, Layout
from plumb.spec.arrays import FloatArray

Columns = dict[str, FloatArray]

MOST_SAMPLES = 1 << 21
"""Longest recording: two hours at 285 Hz, about one gigabyte of working memory."""
OTHERS = ("movement", *(f"ref_{c}" for c in "wxyz"))
"""Columns of a table that are read besides time and sensors, by these very names."""
SHOWN_COLUMNS = 12
"""Most columns of a file that a sentence names."""
_COMMENT = ("#", "//", "%")


@dataclass(frozen=True)
class Part:
    """What a table is expected to have. wanted: quantities; bare: the quantity of columns that are named by their axis
    alone, as the file's name says."""

    wanted: Sequence[str] = SENSORS
    bare: str | None = None


WHOLE = Part()


def too_long(name: str) -> UsageError:
    return UsageError(f"{name} holds more than {MOST_SAMPLES} samples: cut it into shorter recordings")


def read(name: str, lines: Iterator[str], given: Given, taken: list[str], part: Part = WHOLE) -> Columns:
    """The columns of a table as `recording_files.read` returns them. name: of the file; taken: sentences are added.
    Raises UsageError."""
    try:
        return _read(name, lines, given, taken, part)
    except csv.Error as error:
        raise UsageError(f"{name} is no readable table ({error})") from error


def has_header(lines: Iterator[str], given: Given, part: Part) -> bool:
    """Whether one of the first lines names all that is wanted."""
    try:
        first = [text for text, _ in zip(lines, range(text_tables.HEADER_LINES), strict=False)]
        return any(text_tables.layout_of(text, given, (), part.wanted, part.bare) for text in first)
    except csv.Error:
        return False


def _with_header(lines: Iterator[str], given: Given) -> Iterator[str]:
    """With a header of places, 1 2 3, where --columns names the columns by them; with the table of what a
    microcontroller printed, where the lines are labels and values."""
    head = list(itertools.islice(lines, text_tables.HEADER_LINES))
    stamped = serial_dumps.has_stamped_rows(head)
    if stamped:
        head = [serial_dumps.with_stamp_behind(text) for text in head]
        lines = map(serial_dumps.with_stamp_behind, lines)
    places = [one for names in given.columns.values() for one in names]
    if places and all(one.isdigit() for one in places):
        most = max(int(one) for one in places)
        for at, text in enumerate(head):
            for separator in text_tables.SEPARATORS:
                row = text_tables.cells(text, separator)
                if len(row) >= most and all(text_tables.is_value(row[int(one) - 1]) for one in places):
                    header = [str(place + 1) for place in range(len(row))]
                    header[-1:] = ["time"] if stamped else header[-1:]
                    return itertools.chain([separator.join(header) + "\n"], head[at:], lines)
    table = serial_dumps.as_table(itertools.chain(head, lines))
    if not any(text_tables.layout_of(text, given) for text in head) and next(serial_dumps.as_table(head), None):
        return table
    return itertools.chain(head, lines)


def _read(name: str, lines: Iterator[str], given: Given, taken: list[str], part: Part) -> Columns:
    before: list[str] = []
    lines = _with_header(lines, given) if part is WHOLE else lines
    layout, header_at = _header(name, lines, given, part, before)
    rows = _Rows(name, layout.separator, enumerate(lines, header_at + 1))
    first = next(rows, None)
    if first is not None and (with_units := text_tables.with_unit_row(layout, first)):
        layout, first = with_units, next(rows, None)
    if first is None:
        raise UsageError(f"{name} has a header in line {header_at} and no row below it")
    _check_width(name, layout, first, rows.at_line)
    layout = text_tables.without_empty_time(layout, first, given, before, part.bare)
    layout = _timed(name, text_tables.with_first_row(layout, first, given), given)
    layout = text_tables.with_units(name, header_at, layout, given)
    numbers = _numbers(name, layout, first, rows)
    taken.extend(text_tables.sentences(layout, header_at, given))
    if rows.skipped:
        taken.append(
            f"{rows.skipped} lines are no rows of numbers and are left out, the first is line {rows.skipped_at}"
        )
    return _columns(layout, numbers, given)


def _header(name: str, lines: Iterator[str], given: Given, part: Part, before: list[str]) -> tuple[Layout, int]:
    """The layout, and the number of its line. before: the lines before it are added. Raises UsageError for a file
    without one."""
    lacking = ""
    for at_line, text in enumerate(lines, 1):
        if at_line > text_tables.HEADER_LINES:
            break
        if layout := text_tables.layout_of(text, given, before, part.wanted, part.bare):
            absent = _not_there(layout, given, at_line) if part is WHOLE else ""
            if not absent:
                return layout, at_line
            lacking = lacking or absent
        before.append(text)
    if lacking:
        raise UsageError(f"{name} {lacking}")
    first = next((text.strip() for text in before if text.strip()), "")
    if not first:
        raise UsageError(f"{name} is empty")
    if {"step", "digest"} <= set(first.split(",")):
        raise UsageError(f"{name} was exported from a log of a board: replay the log itself")
    if text_tables.lacks_header(before):
        raise UsageError(
            f"{name} has rows without a header; it begins with {first[:80]!r}: say the places of its columns, and how "
            'far apart its rows are, as in --columns "acc=1 2 3,gyr=4 5 6" --units "time=1/100 s,acc=1/16384 g,'
            'gyr=1/131 deg/s"'
        )
    raise UsageError(
        f"{name} needs columns time_s, gyr_x_radps.. (or _dps) and acc_x_mps2.. (or _g); it begins with "
        f"{first[:80]!r}: say which its columns are, as in {COLUMNS_EXAMPLE}{_missing(before, given, part)}"
    )


def _not_there(layout: Layout, given: Given, at_line: int) -> str:
    """Which columns of --columns a header lacks, as the end of a sentence; "" where it has all."""
    lacking = [one for names in given.columns.values() for one in names if one not in layout.header]
    if not lacking:
        return ""
    has = ", ".join(repr(one[:40]) for one in layout.header[:SHOWN_COLUMNS])
    more = ", ..." if len(layout.header) > SHOWN_COLUMNS else ""
    return f"line {at_line} has no column {lacking[0]!r} that --columns names; its columns are {has}{more}"


def _check_width(name: str, layout: Layout, row: list[str], at_line: int) -> None:
    """Raises UsageError for a row with more values than the header names: which belongs to which cannot be told."""
    most, got = len(layout.header), len(row)
    if not any(row[most:]) or not all(text_tables.is_value(one) for one in row if one):
        return
    why = "a name is missing, or a value holds the separator"
    if layout.separator == "," and got >= 2 * most - 1:
        why = "commas in numbers are not told from commas between them: write points, or separate by semicolons"
    raise UsageError(f"{name} line {at_line} has {got} values below a header of {most} columns; {why}")


def _missing(before: Sequence[str], given: Given, part: Part) -> str:
    """What the best of the lines names, as the end of a sentence; "" where none is a header."""
    best_at, best = 0, list[str]()
    for at, text in enumerate(before):
        found = text_tables.named_by(text, given, part.bare)
        best_at, best = (at, found) if len(found) > len(best) else (best_at, best)
    lacking = [quantity for quantity in part.wanted if quantity not in best]
    if not set(best) & set(part.wanted) or not lacking:
        return ""
    words = {"gyr": "a gyro", "acc": "an accelerometer", "mag": "a magnetometer"}
    has = " and ".join(words[one] for one in best if one in words)
    linear = "; a linear acceleration lacks gravity" if "linear" in before[best_at].lower() else ""
    lacks = " and ".join(words[one] for one in lacking)
    return f"; line {best_at + 1} names {has} and not {lacks}{linear}: a folder or zip that holds both can be given"


def _timed(name: str, layout: Layout, given: Given) -> Layout:
    """Raises UsageError for a table without a time, unless --units says how far apart its rows are."""
    if ("time", 0) in layout.named or "time" in given.units:
        return layout
    raise UsageError(
        f'{name} names no time: give --units "time=1/100 s" for rows at 100 Hz, or the column, as in {COLUMNS_EXAMPLE}'
    )


class _Rows:
    """The rows of a table: blank lines and comments are passed over. skipped: lines of text that `skip` counted."""

    def __init__(self, name: str, separator: str, lines: Iterator[tuple[int, str]]) -> None:
        self._name, self._separator, self._lines = name, separator, lines
        self.at_line, self.skipped, self.skipped_at = 0, 0, 0

    def __iter__(self) -> Iterator[list[str]]:
        return self

    def __next__(self) -> list[str]:
        for at_line, text in self._lines:
            self.at_line = at_line
            if text.strip() and not text.startswith(_COMMENT):
                return text_tables.cells(text, self._separator)
        raise StopIteration

    def skip(self) -> None:
        self.skipped += 1
        self.skipped_at = self.skipped_at or self.at_line


def _numbers(name: str, layout: Layout, first: list[str], rows: _Rows) -> dict[str, FloatArray]:
    """The values of each column as written, by quantity and axis, `ref_w` to `ref_z`, and OTHERS."""
    names = {at: f"{said.quantity}_{said.axis}" for at, said in layout.meanings.items()}
    names |= {at: other for at, other in enumerate(layout.header) if other in OTHERS and other not in names.values()}
    names |= {at: f"ref_{c}" for at, c in zip(layout.ref, "wxyz", strict=False)}
    values = {column: array("d") for column in names.values()}
    moments = {at: Moments() for at, said in layout.meanings.items() if said.unit == MOMENT}
    row: list[str] | None = first
    samples = 0
    while row is not None:
        got, wrong = [], ""
        for at in names:
            text = row[at] if at < len(row) else ""
            try:
                got.append(_value(text, layout.separator, moments.get(at)))
            except ValueError:
                wrong = wrong or f"{text[:20]!r} in column {layout.header[at]}"
                got.append(math.nan)
        if wrong and all(math.isnan(value) for value in got):
            rows.skip()
        elif wrong:
            raise UsageError(f"{name} line {rows.at_line}: {wrong} is no number")
        else:
            samples += 1
            if samples > MOST_SAMPLES:
                raise too_long(name)
            for column, value in zip(values, got, strict=True):
                values[column].append(value)
        row = next(rows, None)
    return {column: np.array(one, np.float64) for column, one in values.items()}


def _value(text: str, separator: str, moments: Moments | None) -> float:
    """Raises ValueError. NaN for an empty cell."""
    if moments is not None:
        return moments.seconds(text)
    return text_tables.number(text, separator) if text else math.nan


def _columns(layout: Layout, numbers: dict[str, FloatArray], given: Given) -> Columns:
    """In s, deg/s and g."""
    for span in layout.wraps.values():
        counts = numbers["time_0"]
        turns = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.diff(counts)) < -span / 2.0)])
        numbers["time_0"] = counts + span * turns
    factors = {f"{said.quantity}_{said.axis}": said.factor or 1.0 for said in layout.meanings.values()}
    column = {one: factors.get(one, 1.0) * values for one, values in numbers.items()}
    samples = len(next(iter(column.values())))
    rows_s: FloatArray = np.arange(samples, dtype=np.float64) * (given.factor("time") or 1.0)
    columns: Columns = {"time_s": column.get("time_0", rows_s)}
    for quantity in ("gyr", "acc", "mag"):
        if (quantity, 2) in layout.named:
            columns[quantity] = np.stack([column[f"{quantity}_{axis}"] for axis in range(3)], 1)
    if all(f"ref_{c}" in column for c in "wxyz"):
        columns["ref_quat"] = np.stack([column[f"ref_{c}"] for c in "wxyz"], 1)
    if "movement" in column:
        columns["movement"] = column["movement"]
    return columns

"""Read the columns of a recording, .npz or a table: the formats are at the top of plumb/readers/recording.py.

The readers run in a process of their own with limits (`plumb.files.bounded_reader`): a zip expands to any size, and its
directory, its headers and its decompressors take memory that its length does not show.
"""

from __future__ import annotations

import csv
import json
import math
import zipfile
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from plumb.errors import UsageError
from plumb.files import input_files
from plumb.files.bounded_reader import MIB, Limits, pieces_of
from plumb.readers.imu_files import frames, text_tables
from plumb.readers.imu_files.given import COLUMNS_EXAMPLE, Given, of_text
from plumb.readers.imu_files.header_words import G_MPS2 as G_MPS2
from plumb.spec.arrays import FloatArray

Columns = dict[str, FloatArray]

MOST_SAMPLES = 1 << 21
"""Longest recording: two hours at 285 Hz, about one gigabyte of working memory."""
MOST_BYTES = 256 << 20
ROW_BYTES = 64
"""Bytes of one sample in the widest array that is read: four float128."""
MOST_LINE = 1 << 16
"""Characters of one line of a table."""
LIMITS = Limits(cpu_s=(10.0, 10.0), memory_bytes=(1024 * MIB, 1), output_bytes=(16 * MIB + MOST_SAMPLES * 13 * 8, 0))
"""Limits for reading one recording. A line of a table costs ten conversions of text; 13 columns are the most that are
read."""
NPZ_NAMES = ("gyr", "acc", "rate_hz", "time_s", "ref_quat", "movement")
_ADVICE = "give a recording, .npz or .csv"
OTHERS = ("movement", *(f"ref_{c}" for c in "wxyz"))
"""Columns of a table that are read besides time, gyro and accelerometer, by these very names."""
_TAKEN = "taken"
NOTHING = Given()
_READER = f"{__name__}:pieces"


def read(path: Path, taken: list[str] | None = None, given: Given = NOTHING) -> Columns:
    """gyr_dps and acc_g as gyr (N, 3) and acc (N, 3), time_s, and what else the file has; their shapes are unchecked.
    The content decides on the format, not the name. taken: sentences on what was taken are added to it. given:
    what the file does not say of itself. Raises UsageError with one sentence that names the fault."""
    input_files.check(path, MOST_BYTES, _ADVICE)
    columns: Columns = {}
    pieces = pieces_of(_READER, path, _ADVICE, LIMITS, given.text)
    for head in pieces:
        name, shape = json.loads(head)
        if name == _TAKEN:
            said = json.loads(next(pieces))
            if taken is not None:
                taken.extend(said)
            continue
        columns[name] = np.frombuffer(next(pieces), np.float64).reshape(shape)
    return frames.turned(columns, given.frame) if given.frame else columns


def pieces(path: Path, given_text: str = NOTHING.text) -> Iterator[bytes]:
    """Name and shape of each column as JSON, then its values as float64. Runs in the process of the reader."""
    taken: list[str] = []
    given = of_text(given_text)
    if _is_npz(path):
        if given.units or given.columns:
            option = "--units" if given.units else "--columns"
            raise UsageError(f"{option} is for tables: the arrays of {path.name} have their units and names")
        columns = _read_npz(path)
        taken.append("numpy .npz: time_s or rate_hz, gyr in rad/s, acc in m/s2")
    else:
        columns = _read_csv(path, taken, given)
    if given.frame:
        taken.append(f"axes {given.frame}: {frames.FRAMES[given.frame].said}")
    yield json.dumps([_TAKEN, []]).encode()
    yield json.dumps(taken).encode()
    for name, values in columns.items():
        yield json.dumps([name, values.shape]).encode()
        yield np.ascontiguousarray(values, np.float64).tobytes()


def _is_npz(path: Path) -> bool:
    """A zip, or what says that it is one and is no text."""
    with path.open("rb") as file:
        head = file.read(4096)
    return head.startswith(b"PK") or (path.suffix.lower() == ".npz" and (not head or b"\0" in head or b"," not in head))


def _too_long(path: Path) -> UsageError:
    return UsageError(f"{path.name} holds more than {MOST_SAMPLES} samples: cut it into shorter recordings")


def _check_sizes(path: Path) -> None:
    """Raises UsageError for an array that would take too much memory. Reads only the headers of the arrays, because a
    compressed file of a few kilobytes can expand to gigabytes."""
    with zipfile.ZipFile(path) as archive:
        for name in set(archive.namelist()) & {f"{name}.npy" for name in NPZ_NAMES}:
            with archive.open(name) as member:
                version = np.lib.format.read_magic(member)
                read = np.lib.format.read_array_header_1_0 if version[0] == 1 else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(member)
            if math.prod(shape[:1]) > MOST_SAMPLES or math.prod(shape) * dtype.itemsize > MOST_SAMPLES * ROW_BYTES:
                raise _too_long(path)


def _read_npz(path: Path) -> Columns:
    try:
        _check_sizes(path)
        with np.load(path, allow_pickle=False) as file:
            columns = {name: file[name].astype(np.float64, casting="same_kind") for name in NPZ_NAMES if name in file}
            names = sorted(file.files)
    except UsageError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise many kinds of exceptions for a damaged file
        raise UsageError(f"{path.name} is damaged or no numpy .npz file of plain numbers") from error
    missing = [name for name in ("gyr", "acc") if name not in columns]
    if missing or not ("time_s" in columns or "rate_hz" in columns):
        raise UsageError(f"{path.name} lacks {' and '.join(missing) or 'time_s or rate_hz'}; it has {names}")
    if "time_s" not in columns:
        rate_hz = float(columns["rate_hz"].reshape(-1)[0]) if columns["rate_hz"].size else 0.0
        if not 1.0 <= rate_hz <= 1e5:
            raise UsageError(f"{path.name} says rate_hz {rate_hz:g}; a rate is between 1 and 100000 Hz")
        columns["time_s"] = np.arange(len(np.atleast_1d(columns["gyr"]))) / rate_hz
    columns["gyr"] = np.degrees(columns["gyr"])
    columns["acc"] = columns["acc"] / G_MPS2
    return columns


def _read_csv(path: Path, taken: list[str], given: Given) -> Columns:
    try:
        with path.open(newline="", encoding=text_tables.encoding_of(path)) as file:
            return _table(path, _lines(path, file), taken, given)
    except (OSError, UnicodeError, csv.Error) as error:
        raise UsageError(f"{path.name} is neither .npz nor readable CSV text ({error})") from error


def _table(path: Path, lines: Iterator[str], taken: list[str], given: Given) -> Columns:
    layout, at_line, first = None, 0, ""
    before: list[str] = []
    for at_line, text in enumerate(lines, 1):
        if at_line <= text_tables.HEADER_LINES and (layout := text_tables.layout_of(text, given, before)):
            break
        before += [text] if at_line <= text_tables.HEADER_LINES else []
        first = first or text.strip()
        if at_line > MOST_SAMPLES + 1:
            raise _too_long(path)
    if not first and layout is None:
        raise UsageError(f"{path.name} is empty")
    if {"step", "digest"} <= set(first.split(",")):
        raise UsageError(f"{path.name} was exported from a log of a board: replay the log itself")
    if layout is None:
        raise UsageError(
            f"{path.name} needs columns time_s, gyr_x_radps.. (or _dps) and acc_x_mps2.. (or _g); it begins with "
            f"{first[:80]!r}: say which its columns are, as in {COLUMNS_EXAMPLE}"
        )
    layout = text_tables.with_units(path, at_line, layout, given)
    names = {at: f"{said.quantity}_{said.axis}" for at, said in layout.meanings.items()}
    names |= {at: name for at, name in enumerate(layout.header) if name in OTHERS and name not in names.values()}
    names |= {at: f"ref_{c}" for at, c in zip(layout.ref, "wxyz", strict=False)}
    numbers = {name: array("d") for name in names.values()}
    samples = 0
    for row_at, text in enumerate(lines, at_line + 1):
        if not text.strip() or text.startswith(("#", "//")):
            continue
        row = next(csv.reader([text], delimiter=layout.separator), [])
        samples += 1
        if samples > MOST_SAMPLES:
            raise _too_long(path)
        for at, name in names.items():
            numbers[name].append(_number(path, row_at, layout.header[at], row, at, layout.separator))
    factors = {names[at]: said.factor or 1.0 for at, said in layout.meanings.items()}
    column: Columns = {name: factors.get(name, 1.0) * np.array(values) for name, values in numbers.items()}
    columns = {"time_s": column["time_0"]}
    columns |= {name: np.stack([column[f"{name}_{axis}"] for axis in range(3)], 1) for name in ("gyr", "acc")}
    if all(f"ref_{c}" in column for c in "wxyz"):
        columns["ref_quat"] = np.stack([column[f"ref_{c}"] for c in "wxyz"], 1)
    if "movement" in column:
        columns["movement"] = column["movement"]
    taken.extend(text_tables.sentences(layout, at_line, given))
    return columns


def _lines(path: Path, file: IO[str]) -> Iterator[str]:
    """The lines of a table; raises UsageError for one that is longer than any."""
    while line := file.readline(MOST_LINE):
        if len(line) == MOST_LINE:
            raise UsageError(f"{path.name} has a line of more than {MOST_LINE} characters: it is no table")
        yield line


def _number(path: Path, line: int, name: str, row: list[str], at: int, separator: str) -> float:
    text = row[at].strip() if at < len(row) else ""
    if not text:
        return math.nan
    try:
        return text_tables.number(text, separator)
    except ValueError:
        raise UsageError(f"{path.name} line {line}: {text[:20]!r} in column {name} is no number") from None

"""Read the columns of a recording, .npz or .csv: the formats are at the top of plumb/readers/recording.py.

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
from plumb.spec.arrays import FloatArray

Columns = dict[str, FloatArray]

G_MPS2 = 9.80665
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
_READER = f"{__name__}:pieces"


def read(path: Path) -> Columns:
    """gyr_dps and acc_g as gyr (N, 3) and acc (N, 3), time_s, and what else the file has; their shapes are unchecked.
    Raises UsageError with one sentence that names the fault."""
    input_files.check(path, MOST_BYTES, _ADVICE)
    if path.suffix.lower() not in (".npz", ".csv"):
        raise UsageError(f"{path} is neither .npz nor .csv; see `plumb replay --help` for the formats")
    columns: Columns = {}
    pieces = pieces_of(_READER, path, _ADVICE, LIMITS)
    for head in pieces:
        name, shape = json.loads(head)
        columns[name] = np.frombuffer(next(pieces), np.float64).reshape(shape)
    return columns


def pieces(path: Path) -> Iterator[bytes]:
    """Name and shape of each column as JSON, then its values as float64. Runs in the process of the reader."""
    columns = _read_npz(path) if path.suffix.lower() == ".npz" else _read_csv(path)
    for name, values in columns.items():
        yield json.dumps([name, values.shape]).encode()
        yield np.ascontiguousarray(values, np.float64).tobytes()


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


def _read_csv(path: Path) -> Columns:
    wanted = ["time_s", "movement", *(f"ref_{c}" for c in "wxyz")]
    wanted += [f"gyr_{c}_{u}" for c in "xyz" for u in ("radps", "dps")]
    wanted += [f"acc_{c}_{u}" for c in "xyz" for u in ("mps2", "g")]
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = (row for row in csv.reader(_lines(path, file)) if row)
            header = next(rows, None)
            if header is None:
                raise UsageError(f"{path.name} is empty")
            if {"step", "digest"} <= set(header):
                raise UsageError(f"{path.name} was exported from a log of a board: replay the log itself")
            places = {name.strip(): at for at, name in enumerate(header) if name.strip() in wanted}
            numbers = {name: array("d") for name in places}
            for line, row in enumerate(rows, 2):
                if line > MOST_SAMPLES + 1:
                    raise _too_long(path)
                for name, at in places.items():
                    numbers[name].append(_number(path, line, name, row, at))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path.name} is no readable CSV text ({error})") from error
    column: Columns = {name: np.array(values) for name, values in numbers.items()}
    gyr = _axes(column, "gyr", (("radps", 180.0 / math.pi), ("dps", 1.0)))
    acc = _axes(column, "acc", (("mps2", 1.0 / G_MPS2), ("g", 1.0)))
    if gyr is None or acc is None or "time_s" not in column:
        raise UsageError(f"{path.name} needs columns time_s, gyr_x_radps.. (or _dps) and acc_x_mps2.. (or _g)")
    columns = {"time_s": column["time_s"], "gyr": gyr, "acc": acc}
    if all(f"ref_{c}" in column for c in "wxyz"):
        columns["ref_quat"] = np.stack([column[f"ref_{c}"] for c in "wxyz"], 1)
    if "movement" in column:
        columns["movement"] = column["movement"]
    return columns


def _lines(path: Path, file: IO[str]) -> Iterator[str]:
    """The lines of a table; raises UsageError for one that is longer than any."""
    while line := file.readline(MOST_LINE):
        if len(line) == MOST_LINE:
            raise UsageError(f"{path.name} has a line of more than {MOST_LINE} characters: it is no table")
        yield line


def _number(path: Path, line: int, name: str, row: list[str], at: int) -> float:
    text = row[at].strip() if at < len(row) else ""
    if not text:
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{path.name} line {line}: {text[:20]!r} in column {name} is no number") from None


def _axes(column: Columns, stem: str, units: tuple[tuple[str, float], ...]) -> FloatArray | None:
    for unit, factor in units:
        names = [f"{stem}_{c}_{unit}" for c in "xyz"]
        if all(name in column for name in names):
            return factor * np.stack([column[name] for name in names], 1)
    return None

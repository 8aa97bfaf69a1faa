"""Read the columns of a recording, .npz or a table: the formats are at the top of plumb/readers/recording.py.

The readers run in a process of their own with limits (`plumb.files.bounded_reader`): a zip expands to any size, and its
directory, its headers and its decompressors take memory that its length does not show.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from plumb.errors import UsageError
from plumb.files import input_files
from plumb.files.bounded_reader import MIB, Limits, pieces_of
from plumb.readers.imu_files import frames, table_sets, tables, text_files, ulog
from plumb.readers.imu_files.formats import Format
from plumb.readers.imu_files.given import Given, of_text
from plumb.readers.imu_files.header_words import G_MPS2 as G_MPS2
from plumb.readers.imu_files.tables import MOST_SAMPLES, too_long
from plumb.spec.arrays import FloatArray

Columns = dict[str, FloatArray]

MOST_BYTES = 256 << 20
ROW_BYTES = 64
"""Bytes of one sample in the widest array that is read: four float128."""
LIMITS = Limits(cpu_s=(10.0, 10.0), memory_bytes=(1024 * MIB, 1), output_bytes=(16 * MIB + MOST_SAMPLES * 13 * 8, 0))
"""Limits for reading one recording. A line of a table costs ten conversions of text; 13 columns are the most that are
read."""
NPZ_NAMES = ("gyr", "acc", "rate_hz", "time_s", "ref_quat", "movement")
FORMATS = (
    Format("numpy", "`.npz` with `gyr`, `acc`, and `time_s` or `rate_hz`", "s, rad/s, m/s2; `ref_quat`, `movement`"),
)
_ADVICE = "give a recording, .npz or .csv"
_TAKEN = "taken"
NOTHING = Given()
_READER = f"{__name__}:pieces"


def read(path: Path, taken: list[str] | None = None, given: Given = NOTHING) -> Columns:
    """gyr_dps and acc_g as gyr (N, 3) and acc (N, 3), time_s, and what else the file has; their shapes are unchecked.
    The content decides on the format, not the name. taken: sentences on what was taken are added to it. given:
    what the file does not say of itself. Raises UsageError with one sentence that names the fault."""
    size = _folder_size(path) if path.is_dir() else None
    if size is None:
        input_files.check(path, MOST_BYTES, _ADVICE)
    columns: Columns = {}
    pieces = pieces_of(_READER, path, _ADVICE, LIMITS, given.text, size)
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
    if path.is_dir():
        columns = table_sets.read(path.name or str(path), table_sets.of_folder(path), given, taken)
    elif _begins_with(path, ulog.MAGIC):
        columns = ulog.read(path, taken)
    elif _is_zip_of_tables(path):
        with zipfile.ZipFile(path) as archive:
            columns = table_sets.read(path.name, table_sets.of_zip(archive), given, taken)
    elif _is_npz(path):
        if given.units or given.columns:
            option = "--units" if given.units else "--columns"
            raise UsageError(f"{option} is for tables: the arrays of {path.name} have their units and names")
        columns = _read_npz(path)
        taken.append("numpy .npz: time_s or rate_hz, gyr in rad/s, acc in m/s2")
    else:
        with path.open("rb") as file:
            columns = tables.read(path.name, text_files.lines_of(path.name, file), given, taken)
    if given.frame:
        taken.append(f"axes {given.frame}: {frames.FRAMES[given.frame].said}")
    yield json.dumps([_TAKEN, []]).encode()
    yield json.dumps(taken).encode()
    for name, values in columns.items():
        yield json.dumps([name, values.shape]).encode()
        yield np.ascontiguousarray(values, np.float64).tobytes()


def _begins_with(path: Path, magic: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(magic)) == magic


def _folder_size(path: Path) -> int:
    """Bytes of the files of a folder; raises UsageError for a folder that is no recording."""
    try:
        files = [one.stat().st_size for one in path.iterdir() if one.is_file()]
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}; {_ADVICE}") from None
    if sum(files) > MOST_BYTES or len(files) > table_sets.MOST_MEMBERS:
        most = f"{table_sets.MOST_MEMBERS} files or {MOST_BYTES // MIB} MiB"
        raise UsageError(f"cannot read {path}: it is a folder of more than {most}; {_ADVICE}")
    if not files:
        raise UsageError(f"cannot read {path}: it is a folder, no file; {_ADVICE}")
    return sum(files)


def _is_zip_of_tables(path: Path) -> bool:
    """A zip that holds no array of numpy."""
    if not zipfile.is_zipfile(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError):
        return False
    return bool(names) and not any(name.endswith(".npy") for name in names)


def _is_npz(path: Path) -> bool:
    """A zip, or what says that it is one and is no text."""
    with path.open("rb") as file:
        head = file.read(4096)
    return head.startswith(b"PK") or (path.suffix.lower() == ".npz" and (not head or b"\0" in head or b"," not in head))


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
                raise too_long(path.name)


def _read_npz(path: Path) -> Columns:
    try:
        _check_sizes(path)
        with np.load(path, allow_pickle=False) as file:
            columns = {name: file[name].astype(np.float64, casting="same_kind") for name in NPZ_NAMES if name in file}
            names = sorted(file.files)
    except UsageError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise many kinds of exceptions for a damaged file
        if isinstance(error, zipfile.BadZipFile) and path.suffix.lower() != ".npz":
            raise UsageError(f"{path.name} is a damaged zip, perhaps cut: copy it once more") from error
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

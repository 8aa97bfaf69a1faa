"""Recordings of several tables, in a folder or a zip: one for each sensor, as Sensor Logger and phyphox write them."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from plumb.errors import UsageError
from plumb.readers.imu_files import tables, text_files
from plumb.readers.imu_files.formats import Format
from plumb.readers.imu_files.given import Given
from plumb.readers.imu_files.tables import Columns, Part

Members = Mapping[str, Callable[[], IO[bytes]]]
MOST_MEMBERS = 200
FORMATS = (
    Format(
        "Sensor Logger",
        "a folder or zip: `Gyroscope.csv`, `TotalAcceleration.csv` or `Accelerometer.csv` with `Gravity.csv`",
        "`seconds_elapsed` of each file; rad/s, m/s2; the accelerometer is drawn to the stamps of the gyro; the files "
        "of a watch are left out",
    ),
    Format(
        "phyphox",
        "the zip of CSV: `Gyroscope.csv`, `Accelerometer.csv`",
        "units of the headers, drawn to the stamps of the gyro; `Linear Acceleration.csv` lacks gravity, and is left "
        "out",
    ),
)
_SENSOR_NAMES = (
    ("gyr", r"gyro(?:scope)?|gyroscopeuncalibrated"),
    ("acc", r"totalacceleration|acceleration|accelerometer|accelerometeruncalibrated|acc|accel"),
    ("mag", r"magnetometer|magneticfield|magnetometeruncalibrated"),
    ("gravity", r"gravity"),
)
"""By the names of files, in small letters without spaces and digits, of the body's own sensors."""


def of_folder(path: Path) -> Members:
    """The files of a folder, not of those below it."""
    return {one.name: lambda one=one: one.open("rb") for one in sorted(path.iterdir()) if one.is_file()}  # type: ignore[misc]


def of_zip(archive: zipfile.ZipFile) -> Members:
    """The files of a zip but those of folders named meta, which phyphox has."""
    return {
        name: lambda name=name: archive.open(name)  # type: ignore[misc]
        for name in sorted(archive.namelist())
        if not name.endswith("/") and not re.search(r"(?:^|/)(?:meta|__MACOSX)/", name)
    }


def read(name: str, members: Members, given: Given, taken: list[str]) -> Columns:
    """The columns of the table that has both sensors, or of one for each, brought to the stamps of the gyro. name: of
    the folder or zip; taken: sentences are added. Raises UsageError."""
    if any(one.startswith("xl/") for one in members):
        raise UsageError(f"{name} is a workbook of a spreadsheet: export CSV, or a zip of CSV, instead")
    if len(members) > MOST_MEMBERS:
        raise UsageError(f"{name} holds {len(members)} files: give one recording, of at most {MOST_MEMBERS} files")
    whole = [one for one in members if _has(one, members, Part(), given)]
    if len(whole) > 1:
        raise UsageError(f"{name} holds several recordings: {', '.join(whole[:5])}: give one of them")
    if whole:
        return _table(whole[0], members, Part(), given, taken)
    gyr, acc = (_best(quantity, members, given) for quantity in ("gyr", "acc"))
    if gyr is None or acc is None:
        lacks = " and ".join(word for one, word in ((gyr, "a gyro"), (acc, "an accelerometer")) if one is None)
        names = ", ".join(list(members)[:8]) or "none"
        raise UsageError(f"{name} holds no table of {lacks}; its files: {names}")
    columns = _table(gyr, members, Part(("gyr",), "gyr"), given, taken)
    accel = _table(acc, members, Part(("acc",), "acc"), given, taken)
    gravity = _best("gravity", members, given)
    if gravity is not None and _stem(acc) == "accelerometer" and _sensor_logger(acc, members):
        taken.append(f"{acc} lacks gravity: {gravity} is added to it")
        part = _table(gravity, members, Part(("acc",), "acc"), given, taken)
        accel["acc"] = accel["acc"] + _at(accel["time_s"], part, "acc")
    taken.append(
        f"two clocks: {len(accel['time_s'])} samples of {acc} are drawn to the {len(columns['time_s'])} stamps of {gyr}"
    )
    inside = (columns["time_s"] >= np.nanmin(accel["time_s"])) & (columns["time_s"] <= np.nanmax(accel["time_s"]))
    if np.sum(inside) < 2:
        raise UsageError(f"{name}: the stamps of {gyr} and {acc} have no time in common")
    columns = {one: values[inside] for one, values in columns.items()}
    columns["acc"] = _at(columns["time_s"], accel, "acc")
    mag = _best("mag", members, given)
    if mag is not None:
        columns["mag"] = _at(columns["time_s"], _table(mag, members, Part(("mag",), "mag"), given, taken), "mag")
    return columns


def _at(at_s: np.ndarray, columns: Columns, quantity: str) -> np.ndarray:
    """Lines between the samples of a sensor (N, 3), at these times."""
    time_s, values = columns["time_s"], columns[quantity]
    known = np.isfinite(np.column_stack([time_s, values])).all(axis=1)
    if not known.any():
        return np.full((len(at_s), 3), np.nan)
    order = np.argsort(time_s[known], kind="stable")
    return np.stack([np.interp(at_s, time_s[known][order], one[order]) for one in values[known].T], 1)


def _stem(member: str) -> str:
    return re.sub(r"[\s\d_-]+", "", Path(member).stem).lower()


def _best(quantity: str, members: Members, given: Given) -> str | None:
    """The table of a sensor: by its name, or by a header that names it."""
    pattern = dict(_SENSOR_NAMES)[quantity]
    named = [one for one in members if re.fullmatch(pattern, _stem(one))]
    wanted = "acc" if quantity == "gravity" else quantity
    found = [one for one in named if _has(one, members, Part((wanted,), wanted), given)]
    if not found and quantity in ("gyr", "acc"):
        found = [one for one in members if _has(one, members, Part((wanted,)), given)]
    with_gravity = any(_stem(one) == "gravity" for one in members)

    def rank(one: str) -> int:
        stem = _stem(one)
        if stem.endswith("uncalibrated"):
            return 2
        lacks_gravity = stem == "accelerometer" and not with_gravity and _sensor_logger(one, members)
        return 3 if lacks_gravity else int(stem != "totalacceleration")

    return min(found, key=rank, default=None)


def _sensor_logger(member: str, members: Members) -> bool:
    """Whether the columns are named by their axes alone: an accelerometer of Sensor Logger, which lacks gravity."""
    with members[member]() as file:
        first = next(iter(text_files.lines_of(member, file)), "")
    return "seconds_elapsed" in first and {"x", "y", "z"} <= {one.strip() for one in first.split(",")}


def _has(member: str, members: Members, part: Part, given: Given) -> bool:
    try:
        with members[member]() as file:
            return tables.has_header(text_files.lines_of(member, file), given, part)
    except (UsageError, OSError, RuntimeError, zipfile.BadZipFile, NotImplementedError):
        return False  # a picture or a locked file beside the tables


def _table(member: str, members: Members, part: Part, given: Given, taken: list[str]) -> Columns:
    said: list[str] = []
    with members[member]() as file:
        found = tables.read(member, text_files.lines_of(member, file), given, said, part)
    taken.extend(f"{member}: {one}" if at == 0 else one for at, one in enumerate(said))
    return found

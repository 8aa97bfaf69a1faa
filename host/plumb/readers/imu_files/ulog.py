"""Read a ULog file of PX4: gyro, accelerometer and attitude, in the axes of its body (x front, y right, z down).

The format is that of PX4's documentation, "ULog File Format": a header of 16 bytes, then messages of a length (uint16),
a type (one letter) and a body. `F` defines the fields of a format, `A` gives a format a number, `D` holds a sample.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from plumb.errors import UsageError
from plumb.readers.imu_files.formats import Format
from plumb.readers.imu_files.header_words import G_MPS2
from plumb.readers.imu_files.tables import MOST_SAMPLES, Columns, too_long

MAGIC = b"ULog\x01\x12\x35"
_HEAD_BYTES = 16
_LONGEST = 65535
"""Bytes of a message."""
_FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")
_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "u1", "char": "S1",
}  # fmt: skip
SENSORS, ATTITUDE = "sensor_combined", "vehicle_attitude"
FORMATS = (
    Format(
        "PX4",
        "the log itself, `.ulg`",
        f"`{SENSORS}` in us, rad/s, m/s2; `{ATTITUDE}` as the reference; `--frame frd`",
    ),
)


def read(path: Path, taken: list[str]) -> Columns:
    """The columns as `recording_files.read` returns them; the reference is the autopilot's own estimate, of the sample
    before. taken: sentences are added. Raises UsageError."""
    formats, samples, cut = _messages(path.read_bytes())
    if SENSORS not in samples:
        names = ", ".join(one[:40] for one in sorted(samples)[:8]) or "none"
        raise UsageError(f"{path.name} has no {SENSORS}; its topics: {names}")
    sensors = _rows(path.name, formats, samples, SENSORS)
    columns: Columns = {
        "time_s": sensors["timestamp"].astype(np.float64) * 1e-6,
        "gyr": np.degrees(sensors["gyro_rad"].astype(np.float64)),
        "acc": sensors["accelerometer_m_s2"].astype(np.float64) / G_MPS2,
    }
    taken.append(f"ULog, {SENSORS}: gyro_rad in rad/s, accelerometer_m_s2 in m/s2, timestamp in us")
    if ATTITUDE in samples:
        attitude = _rows(path.name, formats, samples, ATTITUDE)
        at_s = attitude["timestamp"].astype(np.float64) * 1e-6
        before = np.searchsorted(at_s, columns["time_s"], "right") - 1
        known = attitude["q"].astype(np.float64)[np.maximum(before, 0)]
        columns["ref_quat"] = np.where((before >= 0)[:, None], known, np.nan)
        taken.append(f"reference from {ATTITUDE}: the autopilot's own estimate, north east down")
    taken += ["the last message is cut: read up to it"] if cut else []
    return columns


def _messages(data: bytes) -> tuple[dict[str, str], dict[str, list[bytes]], bool]:
    """The formats by name, the bodies of the samples of the first instance of each topic, whether the end is cut."""
    formats: dict[str, str] = {}
    topics: dict[int, str] = {}
    samples: dict[str, list[bytes]] = {}
    at = _HEAD_BYTES
    while at + 3 <= len(data):
        size, kind = struct.unpack_from("<HB", data, at)
        body = data[at + 3 : at + 3 + size]
        at += 3 + size
        if len(body) < size:
            return formats, samples, True
        if kind == ord("F"):
            name, _, fields = body.decode("ascii", "replace").partition(":")
            formats[name] = fields
        elif kind == ord("A") and size > 3 and body[0] == 0:
            topics[struct.unpack_from("<H", body, 1)[0]] = body[3:].decode("ascii", "replace")
        elif kind == ord("D") and size > 2 and (topic := topics.get(struct.unpack_from("<H", body)[0])):
            samples.setdefault(topic, []).append(body[2:])
    return formats, samples, at != len(data)


def _rows(name: str, formats: dict[str, str], samples: dict[str, list[bytes]], topic: str) -> np.ndarray:
    """The samples of a topic as an array with its fields; trailing padding may lack. Raises UsageError."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for text in formats.get(topic, "").split(";"):
        if not (found := _FIELD.fullmatch(text)):
            continue
        kind, count, field = found.groups()
        if kind not in _TYPES or int(count or 1) > 256 or field in [one[0] for one in fields]:
            raise UsageError(f"{name} is damaged: its format of {topic} has the field {text[:40]!r}")
        fields.append((field, _TYPES[kind], (int(count),)) if count else (field, _TYPES[kind]))
    layout = np.dtype(fields)
    if layout.itemsize > _LONGEST:
        raise UsageError(f"{name} is damaged: its format of {topic} is longer than a message")
    needed = {SENSORS: {"gyro_rad": 3, "accelerometer_m_s2": 3}, ATTITUDE: {"q": 4}}[topic]
    for field, count in {"timestamp": 0, **needed}.items():
        if field not in (layout.names or ()) or layout[field].shape != ((count,) if count else ()):
            raise UsageError(f"{name}: {topic} has no field {field} of {count or 1}")
    rows = [one.ljust(layout.itemsize, b"\0")[: layout.itemsize] for one in samples[topic]]
    if len(rows) > MOST_SAMPLES:
        raise too_long(name)
    return np.frombuffer(b"".join(rows), layout)

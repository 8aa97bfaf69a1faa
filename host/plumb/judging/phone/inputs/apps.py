"""Parse the datagrams of phone apps to samples of gyro and accelerometer.

SensaGram (its README and SensorStreamer.kt): one event per datagram, JSON, time in ns since the phone started:

    {"type":"android.sensor.gyroscope","timestamp":3925657519043709,"values":[0.01,-0.02,0.003]}

Sensorstream IMU+GPS and its predecessor Wireless IMU (receivers, and the README of its successor): text, time in s,
then the number and the values of each sensor; 3 is the accelerometer, 4 the gyroscope:

    16836472.12345, 3, 0.123,9.810,-0.054, 4, 0.001,0.002,-0.001, 5, 21.4,-5.3,38.0

SensorUDP (its sources, and GeoGebra's receiver): one line per event with a letter, a count, ms since 1970, and values
of fixed width, with a decimal point or comma. A is the accelerometer; M, O, G, N are magnetometer, orientation and
places. The app sends no gyroscope, so it cannot feed the filters by itself:

    A, 1234, 1384532190123, 000.1225830, 009.7881000, -000.0536000

All three send Android's values: m/s^2, with 1 g upwards at rest, and rad/s, in the phone's axes.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plumb.files.input_files import read_bytes

Sensor = Literal["gyro", "accel"]
Vector = tuple[float, float, float]

G_MPS2 = 9.80665
MOST_FILE_BYTES = 64 << 20
"""Largest file of datagrams: some hours of a phone."""
LARGEST_BYTES = 4096
"""Largest datagram that is parsed; those of the apps are much shorter."""
LATEST_S = 1e11
LARGEST_VALUE = 1e6
"""Largest reading accepted, in the app's unit: far above any sensor, and small enough for sums to stay finite."""
SENSAGRAM_TYPES: dict[str, Sensor] = {"android.sensor.gyroscope": "gyro", "android.sensor.accelerometer": "accel"}
SENSORSTREAM_IDS: dict[int, Sensor] = {3: "accel", 4: "gyro"}
SENSORSTREAM_VALUES = {1: 3, 3: 3, 4: 3, 5: 3, 6: 3, 7: 3, 8: 1, 81: 3, 82: 3, 83: 3, 84: 3, 85: 1, 86: 1}
"""Sensor number -> number of values that follow it."""


class MalformedError(ValueError):
    """Bytes that are not a datagram of a known app."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading: time_s by the phone's clock; xyz in deg/s (gyro) or g (accel), in the phone's axes."""

    sensor: Sensor
    time_s: float
    xyz: Vector


@dataclass(frozen=True, slots=True)
class Datagram:
    """A parsed datagram: its app, and the samples of gyro and accelerometer; other sensors are left out."""

    app: str
    samples: list[Sample]


def parse(data: bytes) -> Datagram:
    """Parse one of the three formats, recognised by the first character; raises MalformedError."""
    if len(data) > LARGEST_BYTES:
        raise MalformedError("too long")
    try:
        text = data.decode("utf-8").strip()
    except UnicodeDecodeError:
        raise MalformedError("no text") from None
    if text.startswith("{"):
        return Datagram("SensaGram", _sensagram(text))
    if len(text) > 2 and text[0] in "AMOGN" and text[1] == ",":
        return Datagram("SensorUDP", _sensorudp(text))
    return Datagram("Sensorstream", _sensorstream(text))


def _sensagram(text: str) -> list[Sample]:
    try:
        event = json.loads(text)
        kind = event["type"]
        if not isinstance(kind, str):
            raise TypeError
    except (ValueError, KeyError, TypeError, RecursionError):
        raise MalformedError("JSON without a type") from None
    if kind not in SENSAGRAM_TYPES:
        return []
    values, stamp = event.get("values"), event.get("timestamp")
    if not isinstance(values, list) or len(values) != 3:
        raise MalformedError("JSON without three values")
    return [_sample(SENSAGRAM_TYPES[kind], _float(stamp) * 1e-9, [_float(value) for value in values])]


def _sensorstream(text: str) -> list[Sample]:
    fields = [field.strip() for field in text.split(",")]
    time_s, at, samples = _float(fields[0]), 1, []
    if len(fields) < 2:
        raise MalformedError("a time and nothing else")
    while at < len(fields):
        number = _float(fields[at])
        count = SENSORSTREAM_VALUES.get(int(number)) if number == int(number) else None
        if count is None:
            break  # an unknown sensor: the number of its values is unknown; the sensors before it are kept
        values = [_float(field) for field in fields[at + 1 : at + 1 + count]]
        if len(values) != count:
            raise MalformedError("ends early")
        if int(number) in SENSORSTREAM_IDS:
            samples.append(_sample(SENSORSTREAM_IDS[int(number)], time_s, values))
        at += 1 + count
    return samples


def _sensorudp(text: str) -> list[Sample]:
    fields = text.split(", ")
    if fields[0] != "A":
        return []
    if len(fields) != 6:
        raise MalformedError("not six fields")
    values = [_float(field.replace(",", ".")) for field in fields[3:]]
    return [_sample("accel", _float(fields[2]) * 1e-3, values)]


def _float(value: object) -> float:
    """The value of a number or a numeric text; raises MalformedError unless it is finite."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise MalformedError("no number")
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise MalformedError("no number") from None
    if not math.isfinite(number):
        raise MalformedError("not finite")
    return number


def _sample(sensor: Sensor, time_s: float, values: list[float]) -> Sample:
    if not 0.0 <= time_s <= LATEST_S:
        raise MalformedError("no time")
    if max(map(abs, values)) > LARGEST_VALUE:
        raise MalformedError("no reading")
    unit = 180.0 / math.pi if sensor == "gyro" else 1.0 / G_MPS2
    return Sample(sensor, time_s, (unit * values[0], unit * values[1], unit * values[2]))


_ONE = re.compile(rb"[^\r\n]*?\}(?=\{)|[^\r\n]+")
"""A datagram in a file: up to the next one of SensaGram on the line, or to the line's end."""


def read_file(path: Path) -> Iterable[bytes]:
    """The datagrams of a file, one per line; those of SensaGram need no line end between them.

    Raises UsageError if the file cannot be read.
    """
    content = read_bytes(path, MOST_FILE_BYTES, "cut the recording, or give a file of a phone's app")
    return (found[0] for found in _ONE.finditer(content) if found[0].strip())

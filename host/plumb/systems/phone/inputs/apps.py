"""What phone apps send over UDP, as samples of the gyro and the accelerometer.

SensaGram (its README and SensorStreamer.kt): one event a datagram, JSON, time in ns since the phone started:

    {"type":"android.sensor.gyroscope","timestamp":3925657519043709,"values":[0.01,-0.02,0.003]}

Sensorstream IMU+GPS, and Wireless IMU before it (receivers and the README of its successor): text, time in s, then for
every sensor its number and its values; 3 is the accelerometer, 4 the gyroscope:

    16836472.12345, 3, 0.123,9.810,-0.054, 4, 0.001,0.002,-0.001, 5, 21.4,-5.3,38.0

SensorUDP (its sources, and GeoGebra's receiver): a line an event, a letter, a count, ms since 1970, values of fixed
width; a comma may stand for the point. A is the accelerometer, M, O, G, N are magnetometer, orientation and places.
Those sources send no gyroscope at all, so this app alone cannot feed the filters:

    A, 1234, 1384532190123, 000.1225830, 009.7881000, -000.0536000

All three pass on Android's own values: m/s^2 with 1 g upwards at rest, and rad/s, in the phone's axes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plumb.files.input_files import read_bytes

Sensor = Literal["gyro", "accel"]
Vector = tuple[float, float, float]

G_MPS2 = 9.80665
MOST_FILE_BYTES = 64 << 20
"""Of a file of datagrams: some hours of a phone."""
LARGEST_BYTES = 4096
"""No app's datagram comes near it; a longer one is refused unread."""
LATEST_S = 1e11
LARGEST_VALUE = 1e6
"""Of a reading, in the app's unit: no sensor comes near it, and the mean of what is larger may not be a number."""
SENSAGRAM_TYPES: dict[str, Sensor] = {"android.sensor.gyroscope": "gyro", "android.sensor.accelerometer": "accel"}
SENSORSTREAM_IDS: dict[int, Sensor] = {3: "accel", 4: "gyro"}
SENSORSTREAM_VALUES = {1: 3, 3: 3, 4: 3, 5: 3, 6: 3, 7: 3, 8: 1, 81: 3, 82: 3, 83: 3, 84: 3, 85: 1, 86: 1}
"""How many values follow a sensor's number."""


class MalformedError(ValueError):
    """Bytes that are no datagram of any known app."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading: time_s by the phone's clock; xyz in deg/s (gyro) or g (accel), in the phone's axes."""

    sensor: Sensor
    time_s: float
    xyz: Vector


@dataclass(frozen=True, slots=True)
class Datagram:
    """What a datagram held; other sensors than the two give an empty list."""

    app: str
    samples: list[Sample]


def parse(data: bytes) -> Datagram:
    """Any of the three formats, told apart by the first character; raises MalformedError."""
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
            break  # a sensor of a later version: how long it is cannot be known, what came before is good
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
    """A number, or text that is one; finite."""
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


def read_file(path: Path) -> Iterable[bytes]:
    """The datagrams of a file, one a line; those of SensaGram may follow each other without a line's end.

    Raises UsageError for a file that cannot be read.
    """
    content = read_bytes(path, MOST_FILE_BYTES, "cut the recording, or give a file of a phone's app")
    return [line for line in content.replace(b"}{", b"}\n{").splitlines() if line.strip()]

"""Tables whose headers do not state the units that their programs are known to write: PX4, blackbox_decode, Xsens."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from plumb.readers.imu_files.given import unit_factor
from plumb.readers.imu_files.header_words import UNITS, Meaning, stated_unit, without_unit

BLACKBOX_COUNTS_PER_G = 2048
"""Counts of accSmooth where acc_1G is not named: of most boards of Betaflight, at +-16 g."""
_ACC_1G = re.compile(r"acc_1G\"?\s*[,:=]\s*\"?([0-9]+)")
_XSENS_RATE = re.compile(r"(?:sample|update|output) ?rate:?[\s,]*([0-9]+\.?[0-9]*)\s*hz", re.IGNORECASE)


@dataclass(frozen=True)
class Convention:
    """columns: by quantity (`ref`: w, x, y, z, which may lack), in lower case without a unit; units: those of columns
    that state none; note, assumed: for people, the second where the accelerometer states no unit; wrap: the count of
    the time that begins again at 0, 0 for none."""

    name: str
    columns: dict[str, list[str]]
    units: dict[str, str]
    note: str = ""
    assumed: str = ""
    wrap: float = 0.0


def _xsens(time: str, unit: str, wrap: float, *, dot: bool) -> Convention:
    """dot: of the small sensors of that name, whose files have deg/s and stamps in us."""
    columns = {
        "time": [time],
        "gyr": [f"gyr_{c}" for c in "xyz"],
        "acc": [f"acc_{c}" for c in "xyz"],
        "ref": [f"quat_{c}" for c in "wxyz"] if dot else [f"quat_q{i}" for i in range(4)],
    }
    name = "Xsens DOT" if dot else "Xsens MT"
    return Convention(
        f"{name} ({time})", columns, {"gyr": "deg/s" if dot else "rad/s", "acc": "m/s2", "time": unit}, wrap=wrap
    )


def conventions(before: Sequence[str]) -> list[Convention]:
    """before: the lines before the header."""
    text = "\n".join(before)
    named, rate = _ACC_1G.search(text), _XSENS_RATE.search(text)
    named = named if named and int(named[1]) else None
    dot = "devicetag" in text.lower()
    counts = int(named[1]) if named else BLACKBOX_COUNTS_PER_G
    of_acc = f"acc_1G {counts} counts/g, as named" if named else f"acc_1G is not named: {counts} counts/g are assumed"
    return [
        Convention(
            "PX4",
            {
                "time": ["timestamp"],
                "gyr": [f"gyro_rad[{i}]" for i in range(3)],
                "acc": [f"accelerometer_m_s2[{i}]" for i in range(3)],
            },
            {"time": "us", "gyr": "rad/s", "acc": "m/s2"},
            "PX4 has x front, y right, z down: --frame frd turns them",
        ),
        Convention(
            "blackbox_decode",
            {
                "time": ["time"],
                "gyr": [f"gyroadc[{i}]" for i in range(3)],
                "acc": [f"accsmooth[{i}]" for i in range(3)],
            },
            {"time": "us", "gyr": "deg/s", "acc": f"1/{counts} g"},
            assumed=of_acc,
        ),
        _ros(),
        _androsensor(),
        _xsens("sampletimefine", "us" if dot else "1/10000 s", 2.0**32, dot=dot),
        _xsens("packetcounter", f"1/{rate[1]} s" if rate and float(rate[1]) else "", 65536.0, dot=dot),
    ]


def _ros() -> Convention:
    """sensor_msgs/Imu as `rostopic echo -p` prints it. Its linear acceleration has gravity."""
    columns = {
        "time": ["field.header.stamp"],
        "gyr": [f"field.angular_velocity.{c}" for c in "xyz"],
        "acc": [f"field.linear_acceleration.{c}" for c in "xyz"],
        "ref": [f"field.orientation.{c}" for c in "wxyz"],
    }
    return Convention("ROS sensor_msgs/Imu", columns, {"time": "ns", "gyr": "rad/s", "acc": "m/s2"})


def _androsensor() -> Convention:
    """Its files whose gyro is named by angles, which Android's orientation has about z, x and y of the device."""
    columns = {
        "time": ["time since start"],
        "gyr": ["gyroscope pitch", "gyroscope roll", "gyroscope yaw"],
        "acc": [f"accelerometer {c}" for c in "xyz"],
    }
    note = "pitch, roll and yaw are taken as rates about x, y and z, as Android names them: gyro-axes says if they are"
    return Convention("AndroSensor", columns, {"time": "ms", "gyr": "rad/s", "acc": "m/s2"}, note)


@dataclass(frozen=True)
class Conventional:
    """The meanings of columns by their places; ref: those of the reference w, x, y, z, or none; wraps: by the
    place of a column, the count at which it begins again at 0."""

    name: str
    meanings: dict[int, Meaning]
    ref: list[int]
    note: str
    wraps: dict[int, float]


def conventional(header: Sequence[str], before: Sequence[str]) -> Conventional | None:
    """By the convention that has all of its columns in the header; None for none."""
    names = [without_unit(cell).lower() for cell in header]
    for one in conventions(before):
        needed = {q: columns for q, columns in one.columns.items() if q != "ref"}
        if not all(name in names for columns in needed.values() for name in columns):
            continue
        meanings = {}
        for quantity, columns in needed.items():
            for axis, name in enumerate(columns):
                at = names.index(name)
                said, unit = stated_unit(header[at]), one.units[quantity]
                if said:
                    meanings[at] = Meaning(quantity, axis, said, UNITS[quantity].get(said))
                else:
                    meanings[at] = Meaning(quantity, axis, unit, unit_factor(quantity, unit) if unit else None)
        reference = one.columns.get("ref", [])
        found = [names.index(name) for name in reference] if all(name in names for name in reference) else []
        stated = any(stated_unit(header[at]) for at, m in meanings.items() if m.quantity == "acc")
        note = one.note or ("" if stated else one.assumed)
        wraps = {at: one.wrap for at, said in meanings.items() if said.quantity == "time" and one.wrap}
        return Conventional(one.name, meanings, found, note, wraps)
    return None

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
_XSENS_RATE = re.compile(r"(?:sample|update) ?rate:?\s*([0-9.]+)\s*hz", re.IGNORECASE)


@dataclass(frozen=True)
class Convention:
    """columns: by quantity (`ref`: w, x, y, z, which may lack), in lower case without a unit; units: those of columns
    that state none; note: for people."""

    name: str
    columns: dict[str, list[str]]
    units: dict[str, str]
    note: str = ""


def _xsens(time: str, unit: str) -> Convention:
    columns = {
        "time": [time],
        "gyr": [f"gyr_{c}" for c in "xyz"],
        "acc": [f"acc_{c}" for c in "xyz"],
        "ref": [f"quat_q{i}" for i in range(4)],
    }
    return Convention(f"Xsens MT ({time})", columns, {"gyr": "rad/s", "acc": "m/s2", "time": unit})


def _conventions(before: Sequence[str]) -> list[Convention]:
    """before: the lines before the header."""
    text = "\n".join(before)
    named, rate = _ACC_1G.search(text), _XSENS_RATE.search(text)
    named = named if named and int(named[1]) else None
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
            of_acc,
        ),
        _xsens("sampletimefine", "1/10000 s"),
        _xsens("packetcounter", f"1/{rate[1]} s" if rate and float(rate[1]) else ""),
    ]


@dataclass(frozen=True)
class Conventional:
    """The meanings of columns by their places; ref: those of the reference w, x, y, z, or none."""

    name: str
    meanings: dict[int, Meaning]
    ref: list[int]
    note: str


def conventional(header: Sequence[str], before: Sequence[str]) -> Conventional | None:
    """By the convention that has all of its columns in the header; None for none."""
    names = [without_unit(cell).lower() for cell in header]
    for one in _conventions(before):
        needed = {q: columns for q, columns in one.columns.items() if q != "ref"}
        if not all(name in names for columns in needed.values() for name in columns):
            continue
        meanings = {}
        for quantity, columns in needed.items():
            for axis, name in enumerate(columns):
                at = names.index(name)
                stated, unit = stated_unit(header[at]), one.units[quantity]
                if stated:
                    meanings[at] = Meaning(quantity, axis, stated, UNITS[quantity].get(stated))
                else:
                    meanings[at] = Meaning(quantity, axis, unit, unit_factor(quantity, unit) if unit else None)
        reference = one.columns.get("ref", [])
        found = [names.index(name) for name in reference] if all(name in names for name in reference) else []
        note = "" if any(stated_unit(header[at]) for at, m in meanings.items() if m.quantity == "acc") else one.note
        return Conventional(one.name, meanings, found, note)
    return None

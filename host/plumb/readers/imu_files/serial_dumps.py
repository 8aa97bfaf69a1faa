"""Labels and values that a microcontroller prints on its serial port, as a table.

`Accel X: 0.10, Y: 0.20, Z: 9.80 m/s^2` in one or several lines a sample, `AcX = 12 | AcY = ...`, `a/g: 1 2 3 4 5 6`
(six counts), with or without the time that a serial monitor puts before each line (`12:34:56.789 -> `).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from plumb.readers.imu_files.formats import Format
from plumb.readers.imu_files.header_words import UNITS, Meaning, meaning

FORMATS = (
    Format(
        "a serial monitor",
        "`Accel X: 0.10, Y: 0.20, Z: 9.80 m/s^2`, `AcX = 12 \\| AcY = ...`, `a/g: 1 2 3 4 5 6`",
        'units as printed, else `--units`; the stamps of the monitor, else `--units "time=1/100 s"`',
    ),
)

_UNITS = sorted({unit for one in ("gyr", "acc") for unit in UNITS[one]}, key=len, reverse=True)
_PAIR = re.compile(
    r"([A-Za-z][\w /().\[\]°²^]{0,40}?)\s{0,8}[:=]\s{0,8}([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"
    rf"(?:\s*({'|'.join(re.escape(unit) for unit in _UNITS)})(?![\w/^²]))?",
    re.IGNORECASE,
)
"""Label, value, unit. The label is bounded: without, a line of 60,000 letters costs a minute."""
_STAMP = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}[.,]\d+)\s*->\s*")
_BARE = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_COUNTS = re.compile(r"a/g:" + r"\s+([-+]?\d+)" * 6)
_SENSORS = [(quantity, axis) for quantity in ("gyr", "acc") for axis in range(3)]
_Key = tuple[str, int]
_Cells = dict[_Key, tuple[str, str]]


def as_table(lines: Iterable[str]) -> Iterator[str]:
    """A header and a row a sample, separated by tabs; nothing for lines without six labelled values of a gyro and an
    accelerometer. Samples that lack one are left out."""
    columns: list[_Key] = []
    for sample in _samples(lines):
        if not columns:
            columns = sorted(sample)
            yield "\t".join(_name(key, sample[key][1]) for key in columns) + "\n"
        yield "\t".join(sample[key][0] if key in sample else "" for key in columns) + "\n"


def has_stamped_rows(lines: Iterable[str]) -> bool:
    """Whether a serial monitor's stamp stands before rows of six bare numbers or more."""
    behind = [line[stamp.end() :] for line in lines if (stamp := _STAMP.match(line))]
    return bool(behind) and len(_BARE.findall(behind[-1])) >= 6 and not _BARE.sub("", behind[-1]).strip(" ,;\t\r\n")


def with_stamp_behind(line: str) -> str:
    """A row with the monitor's stamp as its last cell, so that the places of the others are those that the program
    printed; a header with the word time there."""
    stamp = _STAMP.match(line)
    if not stamp:
        return line
    text = line[stamp.end() :].strip()
    separator = next((one for one in ",;\t" if one in text), " ")
    return f"{text.rstrip(separator)}{separator}{stamp[1] if _BARE.match(text) else 'time'}\n"


def _name(key: _Key, unit: str) -> str:
    quantity, axis = key
    stated = f" ({unit})" if unit else ""
    return f"{quantity}{stated}" if quantity == "time" else f"{quantity} {'xyz'[axis]}{stated}"


def _samples(lines: Iterable[str]) -> Iterator[_Cells]:
    """A sample ends where one of its labels comes again."""
    sample: _Cells = {}
    for line in lines:
        for key, value, unit in _pairs(line):
            if key in sample and key != ("time", 0):
                if all(one in sample for one in _SENSORS):
                    yield sample
                sample = {}
            if key not in sample:
                sample[key] = (value, unit)
    if all(one in sample for one in _SENSORS):
        yield sample


def _pairs(line: str) -> Iterator[tuple[_Key, str, str]]:
    """Quantity and axis, value, unit of a line; a stamp comes behind the sensors, whose labels begin a sample."""
    stamp = _STAMP.match(line)
    text = line[stamp.end() :] if stamp else line
    found: list[tuple[Meaning, str, str]] = []
    if counts := _COUNTS.search(text):
        order = [(quantity, axis) for quantity in ("acc", "gyr") for axis in range(3)]
        found = [(Meaning(*key, "", None), counts[at + 1], "") for at, key in enumerate(order)]
    else:
        last = None
        for label, value, unit in _PAIR.findall(text):
            said = meaning(label, None if last is None else last.quantity)
            if said is None or (said.quantity != "time" and said.quantity not in ("gyr", "acc")):
                continue
            bare = re.fullmatch(r"\s*[xyzXYZ]\s*", label)
            found.append((said, value, unit or ("" if bare else said.unit)))
            last = said if said.quantity != "time" else last
    for said, value, unit in found:
        after = next((one for other, _, one in reversed(found) if other.quantity == said.quantity and one), "")
        yield (said.quantity, said.axis), value, unit or after
    if stamp:
        yield ("time", 0), stamp[1], ""

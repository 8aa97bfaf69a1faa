"""What the words of a column's header say: quantity, axis and unit."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

G_MPS2 = 9.80665
UNITS: dict[str, dict[str, float]] = {
    "time": {
        **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), 1e-3),
        **dict.fromkeys(("us", "µs", "μs", "usec", "micros", "microseconds"), 1e-6),
        **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e-9),
    },
    "gyr": {
        **dict.fromkeys(
            ("rad/s", "radps", "rad s^-1", "rad s-1", "rads", "rad", "radians/s", "rad/sec"), 180.0 / math.pi
        ),
        **dict.fromkeys(("deg/s", "dps", "°/s", "º/s", "degps", "deg s^-1", "deg/sec", "degrees/s", "degs"), 1.0),
        **dict.fromkeys(("mdps", "mdeg/s"), 1e-3),
    },
    "acc": {
        **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "mps2", "m s^-2", "m s-2", "m_s2", "ms2", "m/s/s"), 1.0 / G_MPS2),
        **dict.fromkeys(("m/s\N{REPLACEMENT CHARACTER}", "m/sâ²", "m/s**2", "m/sec^2", "ms^-2"), 1.0 / G_MPS2),
        **dict.fromkeys(("g", "gs", "g's"), 1.0),
        "mg": 1e-3,
    },
    "mag": dict.fromkeys(("ut", "µt", "μt", "nt", "mt", "t", "g", "gauss", "mg", "mgauss", "a.u.", ""), 1.0),
}
"""By quantity: each spelling of a unit, and its factor to s, deg/s and g; a magnetometer keeps its unit. Two spellings
of m/s² are those that a wrong encoding leaves."""
QUANTITIES = {
    "time": r"(?:sample|system|host|log|unix|utc|local|elapsed|device|sensor) ?(?:time|timestamp)|time ?stamp|time|t|"
    r"time since start(?: in)?|elapsed|seconds elapsed|seconds|secs|millis|milliseconds|micros|microseconds|"
    r"date ?time|date|utc|yyyy mo dd hh mi ss sss|packet ?(?:number|counter)|sample ?(?:number|count)|counter|"
    r"zeit|zeitstempel|uhrzeit|datum",
    "gyr": r"gyr|gyro|gyros|gyroscope|angular ?(?:velocity|rate)|w rs s|omega|g|rotation|rotation ?rate|gyroscope raw|"
    r"gyroskop|drehrate|winkelgeschwindigkeit",
    "acc": r"acc|accel|accelerometer|accelerometer raw|acceleration|a rs s|a|total ?acceleration|"
    r"beschleunigung|beschleunigungssensor",
    "mag": r"mag|magn|magnet|magnetometer|magnetic ?field|compass|m",
}
"""By quantity: the words that name it, without axis and unit, in English and in German. "linear acceleration" lacks
gravity and is none."""
OWN_UNITS = {
    **dict.fromkeys(("seconds elapsed", "seconds", "secs"), "s"),
    **dict.fromkeys(("millis", "milliseconds"), "ms"),
    **dict.fromkeys(("micros", "microseconds"), "us"),
}
"""Units that the name of a time is."""
BARE_UNITS = {"gyr": "rad/s", "acc": "m/s2", "mag": ""}
"""Units of columns x, y and z in a file that is named by its quantity: those of Android, and of Sensor Logger."""
_GLUED = re.compile(
    r"(g|a|m|gy|ac|gyr|gyro|gyroscope|acc|accel|acceleration|accelerometer|mag|magn|magnetometer)([xyz])"
)


@dataclass(frozen=True)
class Meaning:
    """One column. quantity: time, gyr, acc or mag; axis: 0 to 2, 0 for time; factor: to s, deg/s or g, None when the
    header states no unit."""

    quantity: str
    axis: int
    unit: str
    factor: float | None


_BRACKET = re.compile(r"[(\[]([^()\[\]]*[^()\[\]\d][^()\[\]]*)[)\]]\s*$")


def unit_of(header: str) -> str:
    """The unit in the brackets of a header, or its last word where that is a unit; "" for none."""
    text = header.strip().lower()
    last = re.split(r"[\s_]+", text)[-1]
    known = any(last in units for units in UNITS.values()) and last != text
    return stated_unit(header) or (last if known else "")


def stated_unit(header: str) -> str:
    """The unit in the brackets of a header; "" for none."""
    bracket = _BRACKET.search(header.strip().lower())
    return bracket[1].strip() if bracket else ""


def without_unit(header: str) -> str:
    """The header without the unit in its brackets."""
    return _BRACKET.sub("", header.strip()).strip()


def meaning(header: str, bare: str | None = None) -> Meaning | None:
    """The meaning of a column, None for one of no concern. Units stand in brackets or as the last word. bare: the
    quantity of columns that are named by their axis alone."""
    text = header.strip().strip('"').strip().lower().replace("accelerometer_m_s2[", "acc_mps2[")
    bracket = _BRACKET.search(text)
    unit = bracket[1].strip() if bracket else ""
    name = text[: bracket.start()] if bracket else text
    words = [word for word in re.split(r"[\s_.\[\]:-]+", name) if word]
    axis: int | None = None
    for at, word in reversed(list(enumerate(words))):
        if word in ("x", "y", "z", "0", "1", "2"):
            axis = "xyz".find(word) if word in "xyz" else int(word)
            del words[at]
            break
    if axis is None and words and (glued := _GLUED.fullmatch(words[0])):
        axis, words[0] = "xyz".index(glued[2]), {"gy": "gyr", "ac": "acc"}.get(glued[1], glued[1])
    if axis is not None and not words and bare is not None:
        unit = unit or BARE_UNITS[bare]
        return Meaning(bare, axis, unit, UNITS[bare].get(unit))
    for quantity, pattern in QUANTITIES.items():
        known = UNITS[quantity]
        if (quantity == "time") != (axis is None):
            continue
        if not unit and len(words) > 1 and words[-1] in known and re.fullmatch(pattern, " ".join(words[:-1])):
            return Meaning(quantity, axis or 0, words[-1], known[words[-1]])
        if re.fullmatch(pattern, " ".join(words)):
            unit = unit or OWN_UNITS.get(" ".join(words), "")
            return Meaning(quantity, axis or 0, unit, known.get(unit, 1.0 if quantity == "mag" else None))
    return None

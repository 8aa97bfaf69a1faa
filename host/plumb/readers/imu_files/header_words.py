"""What the words of a column's header say: quantity, axis and unit."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

G_MPS2 = 9.80665
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9},
    "gyr": {
        **dict.fromkeys(("rad/s", "radps", "rad s^-1", "rad s-1", "rads", "rad"), 180.0 / math.pi),
        **dict.fromkeys(("deg/s", "dps", "°/s", "degps", "deg s^-1"), 1.0),
        "mdps": 1e-3,
    },
    "acc": {
        **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "mps2", "m s^-2", "m s-2", "m_s2", "ms2", "m/s/s"), 1.0 / G_MPS2),
        "g": 1.0,
        "mg": 1e-3,
    },
}
"""By quantity: each spelling of a unit, and its factor to s, deg/s and g."""
QUANTITIES = {
    "time": r"time|timestamp|time since start|time since start in|seconds elapsed|t",
    "gyr": r"gyr|gyro|gyroscope|angular ?(?:velocity|rate)|w rs s|omega|g",
    "acc": r"acc|accel|accelerometer|accelerometer raw|acceleration|a rs s|a",
}
"""By quantity: the words that name it, without axis and unit. "linear acceleration" lacks gravity and is none."""


@dataclass(frozen=True)
class Meaning:
    """One column. quantity: time, gyr or acc; axis: 0 to 2, 0 for time; factor: to s, deg/s or g, None when the
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


def meaning(header: str) -> Meaning | None:
    """The meaning of a column, None for one of no concern. Units stand in brackets or as the last word."""
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
    if axis is None and words and (glued := re.fullmatch(r"(g|a|gyr|gyro|acc|accel)([xyz])", words[0])):
        axis, words[0] = "xyz".index(glued[2]), glued[1]
    for quantity, pattern in QUANTITIES.items():
        known = UNITS[quantity]
        if (quantity == "time") != (axis is None):
            continue
        if not unit and len(words) > 1 and words[-1] in known and re.fullmatch(pattern, " ".join(words[:-1])):
            return Meaning(quantity, axis or 0, words[-1], known[words[-1]])
        if re.fullmatch(pattern, " ".join(words)):
            return Meaning(quantity, axis or 0, unit, known.get(unit))
    return None

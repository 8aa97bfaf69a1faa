"""The words of a record as signals in units: the name with its unit, the unit, and the value of one.

`tilt_turn_q32` is `tilt_deg` in the project's units (deg, deg/s, g) and `tilt_rad` in those of SI. Words whose format
or unit says no quantity, as a variance in lsb, have no signal. Where two words are the same quantity, as the state of a
filter and what is published of it, the signal is the later one, which is published.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

from plumb.spec import declarations

_SCALES: dict[str, tuple[tuple[str, str, float], tuple[str, str, float]]] = {
    "turn": (("_deg", "deg", 360.0), ("_rad", "rad", 2.0 * math.pi)),
    "turn/s": (("_dps", "deg/s", 360.0), ("_radps", "rad/s", 2.0 * math.pi)),
    "turn/s^2": (("_dps2", "deg/s^2", 360.0), ("_radps2", "rad/s^2", 2.0 * math.pi)),
    "g": (("_g", "g", 1.0), ("_mps2", "m/s^2", 9.80665)),
    "m/s": (("_mps", "m/s", 1.0), ("_mps", "m/s", 1.0)),
    "us": (("_us", "us", 1.0), ("_s", "s", 1e-6)),
    "step": (("", "step", 1.0), ("", "step", 1.0)),
    "command": (("", "", 1.0), ("", "", 1.0)),
    "": (("", "", 1.0), ("", "", 1.0)),
}
"""Unit of a declared word -> (end of the signal's name, unit, value of one), of the project and of SI."""
_NAME = re.compile(r"(?P<stem>.+?)(_(turn|turnps|turnps2|g|mps|halfus|step))?(_q\d+)?(?P<index>_\d+)?")
_FORMAT = re.compile(r"Q(\d+)")


@dataclass(frozen=True)
class WordSignal:
    """A word as a signal. name: with its unit at the end; scale: the value of one of the word's integers."""

    name: str
    unit: str
    scale: float
    word: str
    doc: str


@lru_cache(maxsize=64)
def word_signals(system: str, si: bool = False) -> dict[str, WordSignal]:
    """Signal -> where it comes from, in the order of the record. si: in rad, rad/s and m/s^2, else in deg, deg/s and g.
    Raises UsageError for a system that does not exist."""
    found: dict[str, WordSignal] = {}
    for word in declarations.system(system).words:
        bits = 0 if word.format == "integer" else None
        if quantity := _FORMAT.fullmatch(word.format):
            bits = int(quantity[1])
        if bits is None or word.unit not in _SCALES:
            continue
        end, unit, value = _SCALES[word.unit][si]
        parts = _NAME.fullmatch(word.name)
        assert parts is not None
        name = f"{parts['stem']}{parts['index'] or ''}{end}"
        found.pop(name, None)
        found[name] = WordSignal(name, unit, value / 2.0**bits, word.name, word.doc)
    return found

"""Signals in engineering units: name with unit, unit, and scale of every word that is a physical quantity.

The word `tilt_turn_q32` is the signal `tilt_deg` in the project's units (deg, deg/s, g) and `tilt_rad` in SI units. A
word without a physical unit, such as a variance in lsb, has no signal. If two words hold the same quantity (the state
of a filter and its published value), the signal is the later word, which is the published one.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

from plumb.spec import declarations
from plumb.spec.system import UNUSED, Word

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
"""Unit of a declared word -> (suffix of the signal's name, unit, scale), in the project's units and in SI."""
_AS_DECLARED = frozenset(
    (
        "rad",
        "deg",
        "m",
        "mm",
        "kg",
        "N",
        "Nm",
        "Pa",
        "s",
        "ms",
        "ns",
        "Hz",
        "A",
        "mA",
        "V",
        "mV",
        "W",
        "K",
        "degC",
        "count",
    )
)
"""Units of words that are signals as they are: their names end in the unit already, as `current_a_q20`. Whole counts
are those of sensors, and no signals."""
IN_SI = {
    name.removeprefix("_"): (si.removeprefix("_"), by / value)
    for (name, _, value), (si, _, by) in _SCALES.values()
    if name != si
}
"""Suffix of a signal's name in the project's units -> its suffix in SI, and what the value is multiplied by."""
_NAME = re.compile(r"(?P<stem>.+?)(_(turn|turnps|turnps2|g|mps|halfus|step))?(_q\d+)?(?P<index>_\d+)?")
_FORMAT = re.compile(r"Q(\d+)")


@dataclass(frozen=True)
class WordSignal:
    """A word as a signal in `unit`. name: ends in the unit; scale: value of one LSB of the word."""

    name: str
    unit: str
    scale: float
    word: str
    doc: str


@lru_cache(maxsize=64)
def word_signals(system: str, si: bool = False) -> dict[str, WordSignal]:
    """The signals of a system by name, in the order of the record. si: rad, rad/s and m/s^2 instead of deg, deg/s and
    g. Raises UsageError for an unknown system."""
    found: dict[str, WordSignal] = {}
    for word in declarations.system(system).words:
        bits = 0 if word.format == "integer" else None
        if quantity := _FORMAT.fullmatch(word.format):
            bits = int(quantity[1])
        if bits is None:
            continue
        if word.unit in _AS_DECLARED:
            if (word.unit, bits) == ("count", 0):
                continue
            found[_plain_name(word)] = WordSignal(_plain_name(word), word.unit, 2.0**-bits, word.name, word.doc)
            continue
        if word.unit not in _SCALES:
            continue
        end, unit, value = _SCALES[word.unit][si]
        parts = _NAME.fullmatch(word.name)
        assert parts is not None
        name = f"{parts['stem']}{parts['index'] or ''}{end}"
        found.pop(name, None)
        found[name] = WordSignal(name, unit, value / 2.0**bits, word.name, word.doc)
    return found


def scale_of(unit: str, form: str) -> tuple[str, float]:
    """Unit of the project, and the value of one LSB, of an integer with a declared unit and format; a choice, bits or
    an unknown unit stay as they are."""
    quantity = _FORMAT.fullmatch(form)
    if unit not in _SCALES and quantity is not None and unit in _AS_DECLARED:
        return unit, 2.0 ** -int(quantity[1])
    if unit not in _SCALES or (quantity is None and form != "integer"):
        return unit, 1.0
    _, shown, value = _SCALES[unit][0]
    return shown, value / 2.0 ** (int(quantity[1]) if quantity else 0)


def _plain_name(word: Word) -> str:
    return re.sub(r"_q\d+", "", word.name)


def setpoint_signal(system: str) -> WordSignal | None:
    """The setpoint of a system; None for one whose declaration says that its setpoint is not used."""
    word = declarations.system(system).setpoint
    if word.doc == UNUSED or not word.name.startswith("setpoint"):
        return None
    known = (one for one in word_signals(system).values() if one.word == word.name)
    unit, scale = scale_of(word.unit, word.format)
    return next(known, WordSignal(_plain_name(word), unit, scale, word.name, word.doc))

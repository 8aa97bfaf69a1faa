"""Settings: numbers in engineering units, each with the conversion that makes the integer of a parameter of it.

A parameter in a `system.toml` declares its setting; `[[setting]]` declares one that is no single parameter, which the
system's `quantise.py` converts. The dataclasses of a tuning (`plumb.systems.NAME.settings`) are generated from both,
and `plumb.tuning.declared` converts whole tunings.

A conversion is a formula or one of the names below. A formula multiplies the setting by constants or divides it, and
may square what it has so far: `* turn * dt`, `/ turn squared * dt`. Its constants are CONSTANTS, `dt` (the period of a
step in s), and those that `quantise.py` computes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from plumb.errors import UsageError

Names = Mapping[str, Fraction | float]
"""Constant of a formula -> its value."""
CONSTANTS: Names = {"turn": Fraction(360), "tau": Fraction(math.tau), "gravity": Fraction(9.80665)}
"""turn: deg; tau: rad in a turn; gravity: m/s^2."""
SAME, STEPS, CHOICE, SINE, FILTER, WORD = "same", "steps", "choice", "sine", "filter", "word"
"""SAME: the number itself. STEPS: a time in s as the nearest number of steps. CHOICE: a whole number. SINE: of an angle
in deg. FILTER: 1 - exp(-dt / tau) of a time constant in s, 1 for 0. WORD: one of `choices`, as its place in them."""
CONVERSIONS = (SAME, STEPS, CHOICE, SINE, FILTER, WORD)
SQUARED = "squared"
NAME = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+")
TYPE = re.compile(r"[A-Z][A-Za-z0-9]*")
FACTOR = re.compile(r"squared|[*/] \w+")
FORMULA = re.compile(rf"({FACTOR.pattern})( ({FACTOR.pattern}))*")


@dataclass(frozen=True)
class Setting:
    """name: whole (`level.lean_max_deg`). conversion: "" where `quantise.py` converts. default: None if a tuning has to
    give it; an int for a CHOICE, and for a whole number that `quantise.py` converts. low, high: limits of the integer
    where they are narrower than those of the parameter. saturates: more than the largest integer is that integer."""

    name: str
    unit: str
    doc: str
    conversion: str = ""
    default: float | str | None = None
    low: int | None = None
    high: int | None = None
    saturates: bool = False
    choices: tuple[str, ...] = ()

    @property
    def group(self) -> str:
        """The group of settings: `level` of `level.lean_max_deg`."""
        return self.name.rpartition(".")[0]

    @property
    def type(self) -> str:
        """Of the field in the tuning."""
        if self.conversion == WORD:
            return f"Literal[{', '.join(map(repr, self.choices))}]"
        return "int" if self.conversion == CHOICE or (not self.conversion and type(self.default) is int) else "float"

    def limits(self, least: int, most: int) -> tuple[int, int]:
        """Limits of its integer, in a parameter of least to most."""
        return least if self.low is None else self.low, most if self.high is None else self.high


@dataclass(frozen=True)
class SettingGroup:
    """A group of settings, `rates.roll`. type: its class in the tuning. meaning: a phrase that precedes those of its
    settings, "" for none."""

    name: str
    type: str
    doc: str
    meaning: str = ""


def is_conversion(text: str) -> bool:
    """Whether a text is a formula or the name of a conversion."""
    return text in CONVERSIONS or FORMULA.fullmatch(text) is not None


def bits(format_: str) -> int:
    """Binary places of a format: n of Qn, else 0."""
    return int(format_[1:]) if format_.startswith("Q") else 0


def factors(conversion: str) -> list[tuple[str, str]]:
    """Sign and constant of each factor of a formula; SQUARED and "" where it is squared."""
    found = [factor.partition(" ") for factor in FACTOR.findall(conversion)]
    return [(sign, name) for sign, _, name in found]


def power(conversion: str) -> int:
    """Power of the setting in what its integer is proportional to: 2 of a formula that squares it, else 1."""
    return 2 if SQUARED in conversion.split() else 1


def to_number(conversion: str, asked: float, names: Names) -> Fraction:
    """The number that a parameter holds, before it is scaled by its format and rounded."""
    number = Fraction(asked)
    if conversion in (SAME, CHOICE):
        return number
    if conversion == STEPS:
        return Fraction(round(number / Fraction(names["dt"])))
    if conversion == SINE:
        return Fraction(math.sin(math.radians(asked)))
    if conversion == FILTER:
        return Fraction(-math.expm1(-float(names["dt"]) / asked)) if asked > 0 else Fraction(1)
    for sign, name in factors(conversion):
        if sign == SQUARED:
            number *= number
            continue
        factor = Fraction(names[name])
        number = number * factor if sign == "*" else number / factor
    return number


def from_number(conversion: str, number: float, names: Names) -> float:
    """The setting of a number. A FILTER of 0 never follows: infinity; a formula with a factor of 0 stands for 0."""
    if conversion in (SAME, CHOICE):
        return number
    if conversion == STEPS:
        return number * float(names["dt"])
    if conversion == SINE:
        return math.degrees(math.asin(number))
    if conversion == FILTER:
        if number == 0:
            return math.inf
        return -float(names["dt"]) / math.log1p(-number) if number < 1 else 0.0
    for sign, name in reversed(factors(conversion)):
        if sign == SQUARED:
            number = math.sqrt(number)
            continue
        factor = float(names[name])
        if sign == "*":
            number = number / factor if factor else 0.0
        else:
            number *= factor
    return number


def factory_word(setting: Setting, format_: str, most: int, dt: Fraction) -> int:
    """The integer of a setting's default at a period of dt in s."""
    assert isinstance(setting.default, int | float)
    number = to_number(setting.conversion, setting.default, {**CONSTANTS, "dt": dt})
    return min(round(number * (1 << bits(format_))), most)


def read(given: object, doc: str = "") -> Setting:
    """A declared setting. doc: for one that has none of its own. Raises UsageError for a malformed one."""
    if not isinstance(given, Mapping):
        raise UsageError(f"a setting is a table, not {given!r:.40}")
    name = given.get("name", "")
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise UsageError(f"setting {name!r:.60}: its name is that of its group, a point, and its own")
    texts = {key: given.get(key, "") for key in ("unit", "conversion")} | {"doc": given.get("doc", doc)}
    for key, text in texts.items():
        if not isinstance(text, str) or '"' in text or not text.isprintable() or (key != "conversion" and not text):
            raise UsageError(f"setting {name}: {key} is a line of text without quotes, not {text!r:.40}")
    if texts["conversion"] and not is_conversion(texts["conversion"]):
        raise UsageError(
            f"setting {name}: conversion is a formula such as '* turn * dt', or {', '.join(CONVERSIONS)}, "
            f"not {texts['conversion']!r:.40}"
        )
    choices = given.get("choices", [])
    if not isinstance(choices, list) or not all(isinstance(word, str) and word.isidentifier() for word in choices):
        raise UsageError(f"setting {name}: choices is a list of names, not {choices!r:.40}")
    if bool(choices) is not (texts["conversion"] == WORD):
        raise UsageError(f"setting {name}: conversion {WORD!r} has choices, and no other")
    default = given.get("default")
    if choices and default not in (*choices, None):
        raise UsageError(f"setting {name}: default is one of its choices, not {default!r:.40}")
    if not choices and (isinstance(default, bool) or not isinstance(default, int | float | None)):
        raise UsageError(f"setting {name}: default is a number, not {default!r:.40}")
    low, high, saturates = given.get("low"), given.get("high"), given.get("saturates", False)
    for key, limit in (("low", low), ("high", high)):
        if isinstance(limit, bool) or not isinstance(limit, int | None):
            raise UsageError(f"setting {name}: {key} is a limit of its integer, not {limit!r:.40}")
    if not isinstance(saturates, bool):
        raise UsageError(f"setting {name}: saturates is true or false, not {saturates!r:.40}")
    unknown = sorted(given.keys() - {"name", "default", "low", "high", "saturates", "choices", *texts})
    if unknown:
        raise UsageError(f"setting {name}: {unknown[0]} is unknown")
    return Setting(name, default=default, low=low, high=high, saturates=saturates, choices=tuple(choices), **texts)


def read_group(name: str, given: object) -> SettingGroup:
    """A declared group of settings. Raises UsageError for a malformed one."""
    if not isinstance(given, Mapping) or not {"type", "doc"} <= given.keys() <= {"type", "doc", "meaning"}:
        raise UsageError(f"settings: {name} is a table of type, doc and, if it has one, meaning, not {given!r:.60}")
    if not NAME.fullmatch(f"x.{name}") or not all(isinstance(text, str) for text in given.values()):
        raise UsageError(f"settings: {name} has texts, and small letters in its name")
    if not TYPE.fullmatch(given["type"]):
        raise UsageError(f"settings: type of {name} is the name of a class, not {given['type']!r:.40}")
    return SettingGroup(name, given["type"], given["doc"], given.get("meaning", ""))

"""Values of the parameter table in engineering units.

Angles are given in degrees. Quantities per step are converted to quantities per second with the period of the same
table. Variances have no engineering unit here: their lsb is chosen by the host for each set of parameters.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from plumb.spec.parameters import Parameter

_FORMAT = re.compile(r"Q(\d+)|Q\((\d+) - (\w+)\)")
_CHOICE = re.compile(r"(?:: |, )(\d+) (.*?)(?=, \d+ |$)")
_PER_UNIT: dict[str, tuple[str, float]] = {
    "turn": ("deg", 360.0),
    "turn/s": ("deg/s", 360.0),
    "turn/s per count": ("deg/s per count", 360.0),
    "1/turn": ("1/deg", 1.0 / 360.0),
    "s/turn": ("s/deg", 1.0 / 360.0),
    "0.5 us": ("us", 0.5),
}
_PER_STEP: dict[str, tuple[str, float]] = {"turn per step": ("deg/s", 360.0), "per step": ("1/s", 1.0)}
"""Unit of a row -> (unit, scale) after division by the period in s."""


@dataclass(frozen=True)
class Meaning:
    """A value in its engineering unit, or the name of a choice; neither if the format has no engineering unit."""

    value: float | None = None
    unit: str = ""
    choice: str = ""

    def __str__(self) -> str:
        return self.choice if self.value is None else f"{self.value:.6g} {self.unit}".rstrip()


def _fraction_bits(row: Parameter, values: Mapping[str, int]) -> int | None:
    """Fraction bits of the row's integer; None for a format without a binary point."""
    if row.format == "integer":
        return 0
    found = _FORMAT.fullmatch(row.format)
    if not found:
        return None
    if found[1]:
        return int(found[1])
    return int(found[2]) - values.get(f"{row.name.rpartition('.')[0]}.{found[3]}", 0)


def meaning(row: Parameter, values: Mapping[str, int]) -> Meaning:
    """The value of a row in its engineering unit. values: the whole table by name; some formats depend on other
    rows."""
    value = values[row.name]
    if row.format == "choice":
        return Meaning(choice=dict(_CHOICE.findall(row.doc)).get(str(value), ""))
    bits = _fraction_bits(row, values)
    if bits is None or row.unit.endswith("lsb"):
        return Meaning()
    unit, per = _PER_UNIT.get(row.unit, (row.unit, 1.0))
    if row.unit in _PER_STEP:
        unit, per = _PER_STEP[row.unit]
        per /= values["kalman.dt_s_q33"] / 2**33
    return Meaning(value / 2.0**bits * per, unit)

"""What the integers of the table mean, for people: each row's value in engineering units where its format says it.

Angles come out in degrees and what is counted per step in seconds, by the period of the table itself. Variances are in
a unit that the host chose for the set and the board never learns, so their integers stay as they are.
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
"""To be divided by the period."""


@dataclass(frozen=True)
class Meaning:
    """A value in its engineering unit, or the name of a choice; neither where the format does not say."""

    value: float | None = None
    unit: str = ""
    choice: str = ""

    def __str__(self) -> str:
        return self.choice if self.value is None else f"{self.value:.6g} {self.unit}".rstrip()


def _fraction_bits(row: Parameter, values: Mapping[str, int]) -> int | None:
    """How many bits of the integer are behind the point; None where the format does not say."""
    if row.format == "integer":
        return 0
    found = _FORMAT.fullmatch(row.format)
    if not found:
        return None
    if found[1]:
        return int(found[1])
    return int(found[2]) - values.get(f"{row.name.rpartition('.')[0]}.{found[3]}", 0)


def meaning(row: Parameter, values: Mapping[str, int]) -> Meaning:
    """What the row's integer stands for. values: the whole table by name, since some formats lean on other rows."""
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

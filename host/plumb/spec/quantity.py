"""What a field of a tuning is: its unit and its meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

CHOICE = "choice"
"""Unit of a field whose value is one of a few names: a `Literal`."""
NUMBER = "1"
"""Unit of a pure number."""


@dataclass(frozen=True)
class Quantity:
    """What a field of a tuning is.

    unit: of a number; CHOICE; NUMBER. The word `unit` in it stands for the unit of the group that the field is in.
    meaning: a phrase; that of a group precedes those of its fields. also: another whole name of the setting.
    """

    unit: str
    meaning: str
    also: str = ""


def quantity(unit: str, meaning: str, also: str = "") -> Mapping[str, Quantity]:
    """The metadata of a field: `kp_per_deg: float = field(default=0.0, metadata=quantity("1/deg", "gain"))`."""
    return {"quantity": Quantity(unit, meaning, also)}

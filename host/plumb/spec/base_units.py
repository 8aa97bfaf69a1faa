"""Base units: the unit of a word, a channel or a parameter consists of these alone."""

from __future__ import annotations

import re
from collections.abc import Iterable

BASE_UNITS = frozenset(
    re.findall(
        r"\w+",
        "turn rad deg m mm g kg N Nm Pa s ms us ns Hz A mA V mV W K degC bit kbit count edge step lsb unit",
    )
)
"""A unit combines them with numbers, powers, `/`, `per` and `and`."""


def unknown_part(unit: str, quantities: Iterable[str]) -> str:
    """The first part of a unit that is not a base unit; "" if every part is one.

    quantities: names of words and parameters of the system. They may stand in a unit without their own unit and
    format: `lean_max` for lean_max_turn_q34.
    """
    names = tuple(quantities)
    parts: list[str] = re.findall(r"[^\W\d]\w*", unit)
    for part in parts:
        own = any(name == part or name.startswith(f"{part}_") for name in names)
        if part not in BASE_UNITS and part not in ("per", "and") and not own:
            return part
    return ""

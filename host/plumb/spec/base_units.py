"""What the units of words, channels and parameters are made of."""

from __future__ import annotations

import re
from collections.abc import Iterable

BASE_UNITS = frozenset(
    re.findall(
        r"\w+",
        "turn rad deg m mm g kg N Nm Pa s ms us ns Hz A mA V mV W K degC bit kbit count edge step lsb unit",
    )
)
"""With numbers, powers, `/`, `per` and `and` between them."""


def unknown_part(unit: str, quantities: Iterable[str]) -> str:
    """The first word of a unit that is no base unit; "" where all are.

    quantities: names of words and parameters of the system, which are units, too, without their own unit and format:
    `lean_max` of lean_max_turn_q34.
    """
    names = tuple(quantities)
    parts: list[str] = re.findall(r"[^\W\d]\w*", unit)
    for part in parts:
        own = any(name == part or name.startswith(f"{part}_") for name in names)
        if part not in BASE_UNITS and part not in ("per", "and") and not own:
            return part
    return ""

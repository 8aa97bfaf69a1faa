"""The pin sets of a board, from pin_sets.toml: how the strap chooses one, and what it drives."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

PATH = Path(__file__).with_name("pin_sets.toml")


@dataclass(frozen=True)
class PinSet:
    """name: also that of the strap's setting; drives: what its pins move. grounded: the pins of the strap at ground.
    battery: the analog input of the battery's divider; "" without one."""

    name: str
    drives: str
    grounded: tuple[str, ...]
    battery: str


def _read() -> tuple[PinSet, ...]:
    tables = tomllib.loads(PATH.read_text(encoding="utf-8"))
    return tuple(
        PinSet(name, table["drives"], tuple(table["grounded"]), table.get("battery", ""))
        for name, table in tables.items()
    )


PIN_SETS = _read()
"""In the order of their numbers."""

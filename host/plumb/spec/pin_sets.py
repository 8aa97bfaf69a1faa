"""The pin sets of a board, from pin_sets.toml: how the strap chooses one, what it drives, and what it has."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

PATH = Path(__file__).with_name("pin_sets.toml")
STRAP = ("PB4", "PB5")
"""The pins of the strap."""
PARTS = {
    "pulses": "PULSES", "bridge": "BRIDGE", "rotors": "ROTORS", "wheels": "WHEELS",
    "receiver": "RECEIVER", "pulse_train": "RECEIVER", "battery": "BATTERY",
}  # fmt: skip
"""What a pin set may have -> the part of the board that an image uses for it (USED_ in the firmware)."""


@dataclass(frozen=True)
class PinSet:
    """name: also that of the strap's setting; drives: what its pins move; output: that of a system. parts: of PARTS,
    without that of the output. grounded: the pins of the strap at ground. battery: the analog input of the battery's
    divider; "" without one."""

    name: str
    drives: str
    output: str
    parts: tuple[str, ...]
    grounded: tuple[str, ...]
    battery: str


def _read() -> tuple[PinSet, ...]:
    tables = tomllib.loads(PATH.read_text(encoding="utf-8"))
    return tuple(
        PinSet(
            name=name,
            drives=table["drives"],
            output=table["output"],
            parts=(*table.get("parts", ()), *(("battery",) if "battery" in table else ())),
            grounded=tuple(table["grounded"]),
            battery=table.get("battery", ""),
        )
        for name, table in tables.items()
    )


PIN_SETS = _read()
"""In the order of their numbers."""

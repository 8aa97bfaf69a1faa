"""The pin sets of a board, from pin_sets.toml: how the strap chooses one, what it drives, what it has, and its pins."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

PATH = Path(__file__).with_name("pin_sets.toml")
STRAP = ("PB4", "PB5")
"""The pins of the strap."""
PARTS = {
    "pulses": "PULSES", "bridge": "BRIDGE", "rotors": "ROTORS", "wheels": "WHEELS",
    "receiver": "RECEIVER", "pulse_train": "RECEIVER", "battery": "BATTERY",
}  # fmt: skip
"""What a pin set may have -> the part of the board that an image uses for it (USED_ in the firmware)."""


@dataclass(frozen=True)
class Mode:
    """What a pin is. word: PIN_ of the firmware; level: of its pull or its output before it gets this mode. when: the
    pin is open unless `driven` (the saved pin set agrees with the strap), `uart` (the strap is steady), or the image
    uses this part of a board."""

    word: str
    level: bool | None = None
    when: str = ""


OPEN = Mode("PIN_FLOATING")
MODES = {
    "open": OPEN,
    "analog": Mode("PIN_ANALOG"),
    "up": Mode("PIN_INPUT_PULLED", level=True),
    "down": Mode("PIN_INPUT_PULLED", level=False),
    "select": Mode("PIN_OUTPUT_10MHZ", level=True),
    "signal": Mode("PIN_ALTERNATE_10MHZ"),
    "spi": Mode("PIN_ALTERNATE_10MHZ", when="DIGITAL"),
    "i2c": Mode("PIN_ALTERNATE_DRAIN", when="DIGITAL"),
    "tx": Mode("PIN_ALTERNATE_10MHZ", when="uart"),
    "rx": Mode("PIN_INPUT_PULLED", level=True, when="uart"),
    "sticks": Mode("PIN_INPUT_PULLED", level=True, when="RECEIVER"),
    "sticks down": Mode("PIN_INPUT_PULLED", level=False, when="RECEIVER"),
    "pulse": Mode("PIN_ALTERNATE_2MHZ", when="driven"),
    "gate": Mode("PIN_ALTERNATE_10MHZ", when="driven"),
    "motor": Mode("PIN_OUTPUT_10MHZ", level=False, when="driven"),
}
"""Modes of the pins, by their names in pin_sets.toml."""


@dataclass(frozen=True)
class Cell:
    """The pins of a row in one set. modes: one for each; does: in words, "" for nothing; undriven: the set whose modes
    they have in an image that does not drive this one's output, "" for this one; same_as: the set that says it, or
    ""."""

    modes: tuple[str, ...]
    does: str
    undriven: str = ""
    same_as: str = ""


@dataclass(frozen=True)
class Row:
    """Pins that stand together in docs/reference/pins.md, and what they are in each set by its name."""

    pins: tuple[str, ...]
    cells: dict[str, Cell]

    def modes(self, name: str, drives: bool) -> tuple[str, ...]:
        """Of the set of that name, in an image that drives its output or not."""
        cell = self.cells[name]
        return cell.modes if drives or not cell.undriven else self.cells[cell.undriven].modes


@dataclass(frozen=True)
class PinSet:
    """name: also that of the strap's setting; drives: what its pins move; output: that of a system. parts: of PARTS,
    without that of the output. grounded: the pins of the strap at ground. battery: the analog input of the battery's
    divider; "" without one. remap: bits of AFIO_MAPR."""

    name: str
    drives: str
    output: str
    parts: tuple[str, ...]
    grounded: tuple[str, ...]
    battery: str
    remap: tuple[str, ...]


TABLES = tomllib.loads(PATH.read_text(encoding="utf-8"))


def _read() -> tuple[PinSet, ...]:
    return tuple(
        PinSet(
            name=name,
            drives=table["drives"],
            output=table["output"],
            parts=(*table.get("parts", ()), *(("battery",) if "battery" in table else ())),
            grounded=tuple(table["grounded"]),
            battery=table.get("battery", ""),
            remap=tuple(table.get("remap", ())),
        )
        for name, table in TABLES.items()
        if name != "row"
    )


def _cell(pins: Sequence[str], row: Mapping[str, Any], name: str) -> Cell:  # Any: a table of TOML
    said = row.get(name, {"modes": ["open"], "does": ""})
    if isinstance(said, str):
        said = {"as": said}
    if "as" in said:
        return replace(_cell(pins, row, said["as"]), same_as=said["as"], undriven=said.get("undriven", ""))
    modes = tuple(said["modes"])
    modes = modes * len(pins) if len(modes) == 1 else modes
    if (modes and len(modes) != len(pins)) or not set(modes) <= set(MODES):
        raise ValueError(f"{PATH.name}: {name} of {', '.join(pins)} has modes {', '.join(modes)}")
    return Cell(modes, said["does"], said.get("undriven", ""))


def _rows() -> tuple[Row, ...]:
    return tuple(
        Row(tuple(row["pins"]), {one.name: _cell(row["pins"], row, one.name) for one in PIN_SETS})
        for row in TABLES["row"]
    )


PIN_SETS = _read()
"""In the order of their numbers."""
ROWS = _rows()
"""As in docs/reference/pins.md."""

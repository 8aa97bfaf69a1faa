"""The pin-set strap of the board around the chip: PB4 and PB5, each left open or tied to ground by the wiring.

An open pin is lifted by the chip's own pull-up. Which pins of a set are at ground: plumb.spec.pin_sets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.spec.pin_sets import PIN_SETS

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

PINS = ("PB4", "PB5")
GROUNDED = {one.name: one.grounded for one in PIN_SETS}
BY_PIN_SET = tuple(GROUNDED)
"""Strap settings in the order of the pin sets that they choose (IDENTITY.PINS, parameter pins)."""
BATTERY_PINS = {one.name: one.battery for one in PIN_SETS if one.battery}
"""Strap setting -> the input of the battery's divider."""
RISE_US = 100.0
"""Time that the internal pull-up (30 to 50 kOhm, data sheet) needs to lift the wires of the strap: two time constants
of 50 kOhm and 1 nF."""


def set_strap(machine: Machine, strap: str) -> None:
    """Wire the strap; the firmware reads it after the next reset. Raises UsageError for an unknown setting."""
    if strap not in GROUNDED:
        raise UsageError(f"there is no strap setting '{strap}'; use one of {', '.join(GROUNDED)}")
    for pin in PINS:
        machine.load_pull_up(pin, RISE_US)
        machine.drive(pin, False if pin in GROUNDED[strap] else None)

"""The pin-set strap of the board around the chip: PB4 and PB5, each left open or tied to ground by the wiring.

standard    both open: the chip's own pull-ups lift them
bridge      PB5 at ground
quadrotor   PB4 at ground
wheels      both at ground
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.errors import UsageError

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

PINS = ("PB4", "PB5")
GROUNDED: dict[str, tuple[str, ...]] = {"standard": (), "bridge": ("PB5",), "quadrotor": ("PB4",), "wheels": PINS}
BY_PIN_SET = tuple(GROUNDED)
"""Strap settings in the order of the pin sets that they choose (IDENTITY.PINS, parameter pins)."""
BATTERY_PINS = {"quadrotor": "PB0", "wheels": "PA2"}
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

"""The two ways in which a board loses its power."""

from __future__ import annotations

from plumb.f103.machine import Machine


def lose_power(machine: Machine, brown: bool) -> None:
    """brown: the supply dips below what the chip needs; else it is gone for a millisecond."""
    if brown:
        machine.brown_out()
    else:
        machine.power_cut()
        machine.advance_us(1000)
        machine.power_on()

"""The simulated STM32F103 as a board of plumb: its image, its saved parameters, the strap around the chip."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.boards.strap import set_strap
from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS, claims_to_be_ours, find_image, load_image, own_header

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

START_US = 50_000
"""A host opens the port of a board that has been powered for a while: oscillator and ADC are running."""


def open_machine(
    image: Path | None = None,
    part: str = "stm32f103c8",
    *,
    seed: int = 1,
    slots: bytes = b"",
    strap: str = "standard",
    couple: Callable[[Machine], None] | None = None,
) -> Machine:
    """A machine with the image asked for, or with this checkout's build, START_US after power-up.

    slots: what the parameter slots of its flash hold. strap: how the pin-set strap is wired (strap.py).
    couple(machine) attaches a plant before the power comes on: it puts functions of simulated seconds into
    machine.adc, which read machine.pwm.

    Raises UsageError in one sentence: no image, or a damaged one, no unicorn, no such part or strap.
    """
    from plumb.f103.machine import Machine

    path = find_image(image)
    data = load_image(path)
    if claims_to_be_ours(data):
        own_header(data, str(path))
    machine = Machine(data, part, seed=seed)
    set_strap(machine, strap)
    machine.flash.store(PARAMETER_SLOTS - FLASH_BASE, slots)
    if couple is not None:
        couple(machine)
    machine.advance_us(START_US)
    return machine

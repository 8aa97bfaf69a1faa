"""The simulated STM32F103 set up as a board of plumb: image, saved parameters, strap."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.boards import debugging
from plumb.boards.strap import set_strap
from plumb.flash.image import FLASH_BASE, PARAMETER_SLOTS, claims_to_be_ours, find_image, own_header, read_flash

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

START_US = 50_000
"""Time from power-up until the host connects: oscillator and ADC are running by then."""


def require_simulator() -> None:
    """Raises UsageError where the simulator of the processor is not installed."""
    import plumb.f103.machine  # noqa: F401


def open_machine(
    image: Path | None = None,
    part: str = "stm32f103c8",
    *,
    seed: int = 1,
    slots: bytes = b"",
    strap: str = "standard",
    couple: Callable[[Machine], None] | None = None,
    offset: int | None = None,
) -> Machine:
    """A machine with this image, or this checkout's build, START_US after power-up.

    slots: contents of the parameter slots of its flash. strap: setting of the pin-set strap (strap.py).
    couple(machine) attaches a plant before the board starts. offset: of an image behind a boot loader, in bytes.

    An image of plumb handles its faults, and reports them; a fault of any other ends the run (FaultStop).

    Raises UsageError when there is no image, it is damaged, unicorn is missing, or the part or strap is unknown.
    """
    from plumb.f103.machine import Machine

    path = find_image(image)
    data = read_flash(path)
    ours = claims_to_be_ours(data)
    if ours:
        own_header(data, str(path))
    machine = Machine(path, part, seed=seed, faults="run" if ours else "stop", offset=offset)
    set_strap(machine, strap)
    machine.flash.store(PARAMETER_SLOTS - FLASH_BASE, slots)
    if couple is not None:
        couple(machine)
    debugging.debug(machine, path)
    machine.advance_us(START_US)
    return machine

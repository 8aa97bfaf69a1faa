"""Simulated sensor chips with both sensors on the pins of a simulated board, as host/plumb/spec/chips declares them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.attached.chip import Source
from plumb.f103.attached.invensense import Invensense, Part
from plumb.spec import imu_chips

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SELECT_PIN = 4
"""Pin of port A that selects a chip on SPI."""


def identities(name: str) -> dict[int, str]:
    """WHO_AM_I of the declared chip, and of those on modules that are sold as it."""
    chip = imu_chips.chips()[name]
    return {value: title for title, value in chip.identities.items()} or {chip.set_up[0].value: chip.title}


def part_of(name: str) -> Part:
    """What the simulated chip has of the declared one."""
    chip = imu_chips.chips()[name]
    own = chip.invensense
    return Part(
        name=name,
        title=chip.title,
        identity=next(iter(identities(name))),
        address=chip.address or 0,
        spi_mhz=chip.spi_khz / 1000,
        power_on={int(register, 0): value for register, value in own["power_on"].items()},
        spi_alone=tuple(own.get("spi_alone", (0, 0))),
        accel_filter=own.get("accel_filter", False),
    )


def fit(machine: Machine, name: str, rates: Source, forces: Source) -> Invensense:
    """A chip on the pins of its bus."""
    chip = Invensense(machine, rates, forces, part_of(name))
    if imu_chips.one_chip(name).bus == "SPI":
        machine.spi1.devices[SELECT_PIN] = chip
    else:
        machine.i2c_bus.slaves.append(chip)
    return chip

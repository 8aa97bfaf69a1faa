"""All faults, in order of their groups."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch

from plumb import systems
from plumb.errors import UsageError
from plumb.proof.faults import (
    armings,
    axes,
    buses,
    clock,
    flights,
    frames,
    hangs,
    host,
    memory,
    power,
    registers,
    rides,
    samples,
    sensors,
    takeoffs,
)
from plumb.proof.faults.fault import Fault
from plumb.systems.contracts import PINS, AnalogPins

GROUPS = ("sensors", "buses", "clock", "power", "memory", "host", "frames", "hangs", "flights", "rides")
FAULTS: tuple[Fault, ...] = (
    *sensors.FAULTS, *buses.FAULTS, *clock.FAULTS, *power.FAULTS, *memory.FAULTS, *registers.FAULTS,
    *host.FAULTS,
    *armings.FAULTS, *samples.FAULTS, *frames.FAULTS, *hangs.FAULTS,
    *flights.FAULTS, *takeoffs.FAULTS, *axes.FAULTS,
    *rides.FAULTS,
)  # fmt: skip


def tested_systems() -> list[str]:
    """The systems that drive an actuator, which are armed, then those that estimate from the board's own digital
    sensors."""
    driven = [name for name in systems.SYSTEMS if systems.load(name).OUTPUT_FRAMES]
    on_pins = [name for name in systems.with_part(PINS.name) if name not in driven]
    return driven + [name for name in on_pins if not isinstance(systems.load(name, PINS), AnalogPins)]


def chosen(patterns: Sequence[str]) -> list[Fault]:
    """Faults by name or group, with * and ?; without a pattern all. Raises UsageError for a pattern that matches
    none."""
    for pattern in patterns:
        if not any(fnmatch(fault.name, pattern) or fnmatch(fault.group, pattern) for fault in FAULTS):
            raise UsageError(
                f"no fault or group is called '{pattern}'; groups are {', '.join(GROUPS)}; "
                "for the names: plumb faults --list"
            )
    if not patterns:
        return list(FAULTS)
    return [
        fault
        for fault in FAULTS
        if any(fnmatch(fault.name, pattern) or fnmatch(fault.group, pattern) for pattern in patterns)
    ]

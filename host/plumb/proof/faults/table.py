"""All faults, in order of their groups."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch

from plumb import systems
from plumb.errors import UsageError
from plumb.proof.faults import buses, clock, frames, hangs, host, memory, power, sensors
from plumb.proof.faults.fault import Fault

GROUPS = ("sensors", "buses", "clock", "power", "memory", "host", "frames", "hangs")
FAULTS: tuple[Fault, ...] = (
    *sensors.FAULTS, *buses.FAULTS, *clock.FAULTS, *power.FAULTS, *memory.FAULTS, *host.FAULTS,
    *frames.FAULTS, *hangs.FAULTS,
)  # fmt: skip


def driven_systems() -> list[str]:
    """The systems that drive an actuator; no other system can be armed."""
    return [name for name in systems.SYSTEMS if systems.load(name).OUTPUT_FRAMES]


def chosen(patterns: Sequence[str]) -> list[Fault]:
    """Faults by name or group, with * and ?; all without a pattern. Raises UsageError for a pattern that fits none."""
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

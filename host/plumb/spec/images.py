"""The flash images by name: which systems each holds, and how much flash and RAM it may take.

`images.toml` has the named sets and their limits. Which systems a set holds follows from the declarations of the
systems: a new system has an image of its own and is in `all` without an edit of any file. One that says
`in_all = false` is left out of `all`, whose flash a C8 limits.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plumb.errors import UsageError
from plumb.spec import declarations, imu_chips
from plumb.spec.declaration_checks import UNLISTED_IMAGES
from plumb.spec.system import System, group_of

ALWAYS_HELD = ("esc",)
"""Groups that every image holds: the outputs carry neutral pulses with every system."""
ALONE, ALONE_ON_OTHERS, ALL = UNLISTED_IMAGES
"""Tables of images.toml: limits of the images of one system, and of one that stands on others; name and limits of the
image with every system."""


@dataclass(frozen=True)
class Image:
    """One flash image. name: "" for systems that no named image holds alone. systems: in the order of their numbers.

    flash_bytes, ram_bytes: the most that it may take; RAM with the reserved stack. ways: how many ways of wiring the
    sensors it knows, the first of `imu_chips.ways()`.
    """

    name: str
    systems: tuple[str, ...]
    flash_bytes: int
    ram_bytes: int
    ways: int = field(default_factory=lambda: len(imu_chips.ways()))


def images() -> dict[str, Image]:
    """Name -> image: of each system alone, of the sets that have a system, and of all systems."""
    systems, limits = declarations.systems(), declarations.image_limits()
    found = {name: _alone(system) for name, system in systems.items()}
    for name in limits:
        held = tuple(
            system.name for system in systems.values() if (system.in_all if name == ALL else name in system.images)
        )
        if held:
            found[name] = Image(name, held, *limits[name])
    return found


def _alone(system: System) -> Image:
    flash_bytes, ram_bytes = declarations.image_limits()[ALONE_ON_OTHERS if system.stands_on else ALONE]
    own = flash_bytes if system.flash_kib is None else 1024 * system.flash_kib
    ways = len(imu_chips.ways()) if system.accel_bus_max is None else system.accel_bus_max + 1
    return Image(system.name, (system.name,), own, ram_bytes, ways)


def left_out_of_all() -> dict[str, Image]:
    """Name -> own image of each system that `all` leaves out: what runs it where no image is named."""
    found = images()
    return {name: found[name] for name, system in declarations.systems().items() if not system.in_all}


def running(system: str | None) -> Path | None:
    """What to give `find_image` where no image is named: the own image of a system that `all` leaves out, else None."""
    return Path(system) if system is not None and system in left_out_of_all() else None


def image(name: str) -> Image:
    """The image of that name; raises UsageError for an unknown one."""
    found = images().get(name)
    if found is None:
        raise UsageError(f"there is no image '{name}'; there are {', '.join(images())}")
    return found


def holding(systems: Collection[str]) -> list[Image]:
    """The images that hold all these systems, those of fewest systems first."""
    found = [one for one in images().values() if set(systems) <= set(one.systems)]
    return sorted(found, key=lambda one: len(one.systems))


def of_systems(systems: Collection[str]) -> Image:
    """The image of exactly these systems; where none is named, one without a name and with the limits of `all`."""
    for one in holding(systems):
        if len(one.systems) == len(set(systems)):
            return one
    ordered = tuple(name for name in declarations.names() if name in systems)
    return Image("", ordered, *declarations.image_limits()[ALL])


def asked(names: Sequence[str]) -> Image:
    """The image that a build was asked for: by the name of an image, or by names of systems; `all` without any. Raises
    UsageError for a name that is neither."""
    if len(names) < 2:
        return image(names[0] if names else ALL)
    return of_systems([declarations.system(name).name for name in names])


def to_flash(wanted: str, present: Sequence[str]) -> Image:
    """The image to flash for a system that a board lacks: the smallest that keeps the systems which it has."""
    return next((one for one in holding([wanted]) if set(present) <= set(one.systems)), image(wanted))


def held_groups(systems: Collection[str]) -> frozenset[str]:
    """The parameter groups that an image of these systems holds: all but those that only other systems read; and the
    parts of a board with parameters that its systems use. What it does not hold is a constant there, at its
    factory value. The image `all` holds every group, also those of a system that it leaves out."""
    declared = declarations.systems()
    if {name for name, system in declared.items() if system.in_all} <= set(systems):
        systems = tuple(declared)
    read = {name: {*system.all_groups, *system.parts, *ALWAYS_HELD} for name, system in declared.items()}
    others = set().union(*read.values())
    mine = set().union(*(read[name] for name in systems if name in read))
    shared = {group_of(row["name"]) for row in declarations.shared()["parameter"]}
    return frozenset(((shared - others) | mine) - {""})


def not_held(group: str, present: Sequence[str]) -> str:
    """That an image of the systems `present` does not hold a parameter group, and which image does, as the beginning of
    a sentence; "" where it holds it, and for an image without a system that is known."""
    if not group or not present or group in held_groups(present):
        return ""
    readers = [name for name, system in declarations.systems().items() if group in (*system.all_groups, *system.parts)]
    best = next(one for one in holding(present) if set(readers) & set(one.systems))
    return (
        f"the board's image has only {', '.join(present)}, and does not hold the parameters of {group}: "
        f"plumb flash --image {best.name} holds them"
    )


def lacking(wanted: str, present: Sequence[str]) -> str:
    """What to do where a board's image has no system `wanted`, as a sentence. present: the systems that it has."""
    best = to_flash(wanted, present)
    there = ", ".join(present) or "none that this version of plumb knows"
    lost = [name for name in present if name not in best.systems]
    kept = f", but not {', '.join(lost)}" if lost else f", and keeps {' and '.join(present)}" if present else ""
    others = [one.name for one in holding([wanted]) if one != best]
    so = f"so have the images {' and '.join(others)}" if len(others) > 1 else f"so has the image {''.join(others)}"
    return f"the board's image has no {wanted}, only {there}: plumb flash --image {best.name} has it{kept}; {so}"

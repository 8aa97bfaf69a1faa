"""What a fault is: declared data with a name, an injection, and what has to follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.faults.reports import Told

if TYPE_CHECKING:
    from plumb.faults.scene import Scene

Action = Callable[["Scene"], None]


@dataclass(frozen=True)
class Fault:
    """One row of the fault table.

    name: unique; lower case with hyphens. group: sensors, buses, clock, power, memory, host, frames or hangs.
    what: what is injected and where, as one phrase. inject: does it, at pins, buses, memory or frames; it may let time
    pass. limit: a row of limits.toml. told: where it must be reported, all of them; an alternative is a tuple within.
    needs: features that the scene must have (Scene.features). link: what the host that armed speaks over.
    prepare: brings the scene to where the fault is injected; time counts from its end.
    holds: True, and the fault must not act: all steps are as without it, and the board stays as armed as it was.
    moves_on: True, and the board goes on driving, but as it should: the report says from when on.
    after: what happens at the end (the host is back, the supply is back); outputs must stay safe from there on.
    phases: injected at many phases of steps, pulses and keep-alives; the worst one counts. variants: injected in so
    many ways (Scene.variant), the worst one counts. interrupt: number of the exception that must be in use; 0: none.
    """

    name: str
    group: str
    what: str
    inject: Action
    limit: str
    told: tuple[Told | tuple[Told, ...], ...] = ()
    needs: frozenset[str] = frozenset()
    link: str = "serial"
    prepare: Action | None = None
    holds: bool = False
    moves_on: bool = False
    after: Action | None = None
    phases: bool = False
    variants: int = 1
    interrupt: int = 0

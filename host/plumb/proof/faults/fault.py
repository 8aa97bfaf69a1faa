"""Fault: the declaration of one fault, its injection, and the reaction that must follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plumb.proof.faults.reports import Told

if TYPE_CHECKING:
    from plumb.proof.faults.scene import Scene

Action = Callable[["Scene"], None]


@dataclass(frozen=True)
class Fault:
    """One row of the fault table.

    name: unique; lower case with hyphens. group: one of table.GROUPS.
    what: the injection and its place, as one phrase. inject: injects at pins, buses, memory or frames; time may
    pass meanwhile. limit: a row of limits.toml. told: all reports that the board must make; a tuple inside lists
    alternatives. needs: features that the scene must have (Scene.features); with `estimate` the fault is only for
    systems that drive nothing. link: link of the host that armed; scene.RECEIVER: a pilot did.
    prepare: runs before the injection; time counts from its end.
    holds: the fault must have no effect: all steps equal those without it, and the board stays armed or disarmed.
    by: the layer that must make the outputs safe (outputs.PROGRAM, outputs.RESET), where a second layer behind it would
    hide its failure; "": any.
    moves_on: the board must keep driving; from the time of its report it must behave as required.
    after: runs at the end (the host or the supply is back); outputs must stay safe afterwards.
    judge: looks at the scene after the limits have passed; why it is not as it should be, "" when it is.
    phases: inject at many phases of steps, pulses and keep-alives; the worst result counts. variants: number of ways
    to inject (Scene.variant); the worst result counts. interrupt: exception that must be enabled; 0: none.
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
    by: str = ""
    moves_on: bool = False
    after: Action | None = None
    judge: Callable[[Scene], str] | None = None
    phases: bool = False
    variants: int = 1
    interrupt: int = 0

"""Machines that take long to bring to where a test begins: brought there once in a process, then put back."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import can

from plumb.f103.machine import Machine
from plumb.f103.snapshot import Snapshot


class OnMachine(Protocol):
    """Anything that belongs to one simulated board."""

    machine: Machine


Thing = TypeVar("Thing", bound=OnMachine)

_made: dict[str, tuple[Any, Snapshot]] = {}


def as_made(name: str, make: Callable[[], Thing]) -> Thing:
    """The thing of this name as make() left it, whatever a test has done to it, its board and its session since."""
    if name not in _made:
        thing = make()
        _made[name] = thing, thing.machine.snapshot(thing)
        session = getattr(thing, "session", None)
        if session is not None:  # or python-can finds fault with it at the end; no word goes to the board
            atexit.register(can.BusABC.shutdown, session.bus)
    thing, snapshot = _made[name]
    thing.machine.restore(snapshot)
    return thing

"""The debugger of this process: while it is served, every simulated chip that is opened stops for it."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plumb.f103.gdb_server import GdbServer
    from plumb.f103.machine import Machine

_served: list[GdbServer] = []


def _say(text: str) -> None:
    print(f"plumb: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def debugged(port: int | None, *, waits: bool = False, say: Callable[[str], None] = _say) -> Iterator[None]:
    """Within this context gdb is served at this port of the loopback address; 0: a free one; None: it is not.

    waits: chips stand before their first instruction until gdb has come. say: gets the command for gdb, and a sentence
    when gdb goes without leaving. Raises LinkError for a port that is taken, UsageError without the simulator.
    """
    if port is None:
        yield
        return
    import plumb.f103.machine  # noqa: F401  says how the simulator is installed where it is not
    from plumb.f103.gdb_server import GdbServer

    server = GdbServer(port, waits=waits, say=say)
    _served.append(server)
    try:
        yield
    finally:
        _served.remove(server)
        server.close()


def debug(machine: Machine, image: Path) -> None:
    """Let the debugger of this process, if there is one, have this machine, which runs the image."""
    if _served:
        server, elf = _served[-1], image.with_suffix(".elf")
        machine.debug(server)
        server.announce(f"gdb-multiarch {elf if elf.exists() else ''} -ex 'target extended-remote :{server.port}'")


def ends(given_up: Callable[[], bool]) -> None:
    """From now on a chip that stands runs on once given_up() is true."""
    for server in _served:
        server.ends = given_up


def while_standing(tell: Callable[[], object]) -> None:
    """From now on tell() is called several times a second while a chip stands."""
    for server in _served:
        server.tell = tell


def wall_s() -> float:
    """Time on the wall in seconds, which stands while a chip stands for the debugger: what is held to real time is not
    late then."""
    return time.monotonic() - sum(server.stood_s for server in _served)

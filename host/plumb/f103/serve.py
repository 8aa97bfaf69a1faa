"""The virtual board as a process of its own: its UART behind a pseudo-terminal or a TCP port, at the pace of the wall
clock and never faster. One client at a time; clients come and go, the board runs on. What the board sends while
nobody listens is lost, as on a cable."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from pathlib import Path

from plumb.endings import endings
from plumb.f103.machine import Machine
from plumb.f103.timeline import TICKS_PER_S
from plumb.line import Line, open_line

SLICE_S = 0.0003
"""Rest between two turns of the loop, and so the grain of the pace."""
LAG_S = 0.05
"""When the machine cannot keep up by more than this, time is given up rather than chased."""


def run_paced(machine: Machine, line: Line, stopped: Callable[[], bool]) -> None:
    """Run the machine at wall-clock pace, moving bytes between its UART and the line, until stopped() holds."""
    begin_wall, begin_ticks = time.monotonic(), machine.now
    while not stopped():
        elapsed = time.monotonic() - begin_wall
        due = begin_ticks + int(elapsed * TICKS_PER_S)
        machine.run_to(min(due, machine.now + int(4 * SLICE_S * TICKS_PER_S)))
        behind_s = (due - machine.now) / TICKS_PER_S
        if behind_s > LAG_S:
            begin_wall += behind_s
        data = line.read()
        if data:
            machine.uart.write(data)
        waiting = machine.uart.in_waiting
        if waiting:
            line.write(machine.uart.read(waiting))
        if behind_s < SLICE_S:
            descriptor = line.watch()
            # Sleep for a slice, or less when the line has something. Not selectors: epoll counts in milliseconds.
            select.select([] if descriptor is None else [descriptor], [], [], SLICE_S)


def serve(
    machine: Machine,
    spec: str,
    *,
    link: Path | None = None,
    couple: Callable[[Machine], None] | None = None,
    announce: Callable[[str], None] = print,
) -> int:
    """Serve the machine's UART on `spec` until SIGINT or SIGTERM; returns that signal's number.

    couple(machine) attaches a plant before time starts: it puts functions of simulated seconds into machine.adc,
    which read machine.pwm. announce gets the address that pyserial can open.
    """
    line = open_line(spec, link)
    try:
        if couple is not None:
            couple(machine)
        with endings() as caught:
            announce(line.address)
            run_paced(machine, line, lambda: bool(caught))
            return caught[0]
    finally:
        line.close()

"""Watch a running board: tilt, bias, rates, pulses, mode, what blocks arming, counters and losses.

    plumb monitor --board serial:/dev/ttyUSB0                 whatever is running there, read-only
    plumb monitor --board serial:/dev/ttyUSB0 --run live      begin a run on its own sensors, unarmed
    plumb monitor --board serial:/dev/ttyUSB0 --reconnect     wait for the board, and come back to it when it is lost
    plumb monitor --board virtual --run live --seconds 20     the system of the image in motion, on the simulated board
    plumb monitor --board virtual --run live --system balancer       or another system's plant, on its own sensors

On a terminal the display is drawn ten times a second: every signal with its smallest and largest value and its recent
course, what blocks arming, faults, counters. Keys: q ends, space freezes, r begins minimum and maximum again, + and -
change the time span. It needs the extra `monitor`, and has no colours with NO_COLOR set. Elsewhere, and with --lines,
one line a second is printed; with --json one line of JSON for each update. --udp 9870 also sends every step as JSON in
UDP datagrams to this machine (to another with HOST:PORT): PlotJuggler plots them.

Ends after --seconds, or with Ctrl-C; both are a normal end. Without --run the link is read-only and a run in progress
goes on; the host that began it selected the signals that it sends. A serial port has one client at a time, and opening
it disarms a board that a host armed: watch such a run in the program that armed it. A board that the arm switch armed
stays armed. --run live ends a run in progress, and its own run at the end. With --reconnect it begins another one when
the board comes back without a run; it does not end a run that another host has begun meanwhile.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.boards.link import LinkBoard
    from plumb.link.identity import Identity
    from plumb.link.json_stream import JsonStream
    from plumb.link.monitor import Extremes, Snapshot
    from plumb.link.session import Session

LOOKS_PER_LINE = 10
RECONNECT_INTERVAL_S = 0.5
"""Pause between two attempts to open the board."""
KEY_INTERVAL_S = 0.05
SPEED_OVER_S = 2.0
"""Time over which the speed of a simulated board is measured."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    parser.add_argument("--run", choices=("live",), help="begin a run on the board's own sensors, unarmed")
    parser.add_argument("--reconnect", action="store_true", help="wait for the board, and for it to come back")
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    parser.add_argument("--udp", metavar="[HOST:]PORT", help="also send every step as JSON over UDP, for PlotJuggler")
    parser.add_argument("--lines", action="store_true", help="one line a second on a terminal, too")
    options.add_json(parser, ", one object a line")


class View(Protocol):
    """View that shows looks. begin: a board answers; show: one look, with the speed of a simulated board; trouble:
    why there is none; ended: whether the user has asked for the end."""

    def __enter__(self) -> object: ...
    def __exit__(self, *_: object) -> None: ...
    def begin(self, identity: Identity) -> None: ...
    def show(self, snapshot: Snapshot, extremes: Extremes, speed: float | None = None) -> None: ...
    def trouble(self, text: str) -> None: ...
    def ended(self) -> bool: ...


class Printed:
    """Lines on stdout: one for every LOOKS_PER_LINE looks, or JSON for each."""

    def __init__(self, as_json: bool) -> None:
        self._json, self._looks = as_json, 0

    def __enter__(self) -> Printed:
        return self

    def __exit__(self, *_: object) -> None: ...

    def begin(self, identity: Identity) -> None:
        self._looks = 0
        if identity.mismatch:
            print(f"plumb: warning: {identity.mismatch}", file=sys.stderr)

    def show(self, snapshot: Snapshot, extremes: Extremes, speed: float | None = None) -> None:
        from plumb.cli.monitor_line import line

        self._looks += 1
        if self._json:
            print(json.dumps(snapshot), flush=True)
        elif self._looks % LOOKS_PER_LINE == 0:
            print(line(snapshot), flush=True)

    def trouble(self, text: str) -> None:
        print(f"plumb: {text}", file=sys.stderr, flush=True)

    def ended(self) -> bool:
        return False


def view_of(arguments: argparse.Namespace) -> tuple[View, bool]:
    """The view that the options and the terminal allow, and whether it is drawn on a terminal."""
    from plumb.extras import install_hint

    if arguments.json or arguments.lines or not sys.stdout.isatty():
        return Printed(arguments.json), False
    try:
        from rich.console import Console
    except ImportError:
        print(f"plumb: lines, because the display needs rich; install it {install_hint('monitor')}", file=sys.stderr)
        return Printed(False), False
    console = Console(highlight=False)
    if console.is_dumb_terminal:
        return Printed(False), False
    from plumb.cli.monitor_screen import Screen

    return Screen(console), True


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import LinkError, UsageError
    from plumb.link.json_stream import JsonStream, parse_target
    from plumb.link.monitor import Extremes
    from plumb.process_signals import Terminated

    options.check_duration(arguments.seconds)
    if arguments.reconnect and arguments.board == "virtual":
        raise UsageError("--reconnect is for a board over serial or CAN: --board virtual is never lost")
    stream = None if arguments.udp is None else JsonStream(*parse_target(arguments.udp))
    view, on_terminal = view_of(arguments)
    watching = Watching(arguments, view, on_terminal, Extremes(), stream)
    try:
        with view, contextlib.closing(stream) if stream else contextlib.nullcontext():
            while True:
                try:
                    return watching.once()
                except LinkError as error:
                    if not arguments.reconnect or watching.over():
                        raise
                    watching.say(str(error))
                if watching.pause():
                    return 0
    except KeyboardInterrupt as error:  # while there is no board to show
        if not arguments.reconnect or isinstance(error, Terminated):
            raise
        return 0


class Watching:
    """The looks at one board, over every connection to it.

    A connection counts the --seconds by the board's clock, which is simulated for --board virtual; with --reconnect
    they are counted by this machine's, so that the time without a board counts, too.
    """

    def __init__(
        self,
        arguments: argparse.Namespace,
        view: View,
        on_terminal: bool,
        extremes: Extremes,
        stream: JsonStream | None,
    ) -> None:
        self._also = None if stream is None else stream.feed
        self.arguments, self.view, self.on_terminal, self.extremes = arguments, view, on_terminal, extremes
        self._begin_s = time.monotonic()
        self._run_tag: int | None = None
        self._said = ""

    def over(self) -> bool:
        """Whether the --seconds have passed."""
        seconds = self.arguments.seconds
        return seconds is not None and time.monotonic() - self._begin_s >= seconds

    def say(self, text: str) -> None:
        if text != self._said:
            self._said = text
            self.view.trouble(f"{text}; trying again")

    def pause(self) -> bool:
        """Wait until the next attempt; True once the user has ended the command. Raises KeyboardInterrupt."""
        end_s = time.monotonic() + RECONNECT_INTERVAL_S
        while time.monotonic() < end_s:
            if self.view.ended():
                return True
            time.sleep(KEY_INTERVAL_S)
        return False

    def once(self) -> int:
        """Connect and show looks until the end; raises LinkError when the board is lost."""
        from plumb.process_signals import raise_ending

        arguments = self.arguments
        with options.linked_board_of(arguments) as board:
            plant = attach_plant(board, arguments.system, arguments.scenario, arguments.seed)
            session = board.session
            identity = session.identity or session.connect()
            self.view.begin(identity)
            begun = self._begin_run(session)
            caught = self._watch(session, Pace(session) if plant else None)
            if begun:
                session.end()
        if signal.SIGTERM in caught:  # Ctrl-C is a normal end, this is none
            raise_ending([signal.SIGTERM])
        return 0

    def _begin_run(self, session: Session) -> bool:
        """Begin the run of --run live, or only listen; True if the run on the board is this command's to end."""
        from plumb.link import monitor

        if not self.arguments.run:
            monitor.read_only(session)
            return False
        if self._run_tag is not None:  # a connection after the first one
            mode, tag = monitor.present_run(session)
            if mode != "IDLE":
                return tag == self._run_tag
        monitor.begin_live(session)
        self._run_tag = session.run_tag
        return True

    def _watch(self, session: Session, pace: Pace | None) -> Sequence[int]:
        """Show looks until the end; returns the signals that ended it."""
        from plumb.link import monitor
        from plumb.process_signals import endings

        seconds = self.arguments.seconds
        if seconds is not None and self.arguments.reconnect:
            seconds = max(monitor.EVERY_S, seconds - (time.monotonic() - self._begin_s))
        with endings() as caught:
            for snapshot in monitor.watch(session, seconds, self.extremes, self._also):
                self._said = ""
                if caught or self.view.ended():
                    break
                self.view.show(snapshot, self.extremes, pace.speed() if pace else None)
                if pace and self.on_terminal:
                    pace.wait()
        return caught


class Pace:
    """Time of a board simulated in this process against this machine's time."""

    def __init__(self, session: Session) -> None:
        self._clock = session.clock
        self._begin = session.clock(), time.monotonic()
        self._measured = [self._begin]

    def wait(self) -> None:
        """Sleep until real time has caught up."""
        time.sleep(max(0.0, self._clock() - self._begin[0] - (time.monotonic() - self._begin[1])))

    def speed(self) -> float | None:
        """Simulated seconds per second over about SPEED_OVER_S; None at the beginning."""
        now = self._clock(), time.monotonic()
        self._measured.append(now)
        while now[1] - self._measured[0][1] > SPEED_OVER_S:
            self._measured.pop(0)
        first = self._measured[0]
        return (now[0] - first[0]) / (now[1] - first[1]) if now[1] - first[1] > SPEED_OVER_S / 4 else None


def attach_plant(board: LinkBoard, system: str | None, scenario: str | None, seed: int) -> bool:
    """Put a plant with prescribed motion on the pins of a board simulated in this process; False for another board."""
    from plumb.errors import UsageError

    if board.name != "virtual":
        if system or scenario:
            remedy = "`plumb params tuning SYSTEM` makes another board that system"
            raise UsageError(f"--system and --scenario are for --board virtual, whose pins a plant drives; {remedy}")
        return False
    from plumb.boards import plant_on_pins
    from plumb.boards.contract import SimulatedBoard

    assert isinstance(board, SimulatedBoard)
    plant_on_pins.show(board, system or board.session.system, scenario, seed)
    return True

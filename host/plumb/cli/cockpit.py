"""Open a live page of a board: plots, attitude, health, and a light that is green while every bit equals the model.

    plumb cockpit --board virtual                       the simulated board with its plant; arm it from the page
    plumb cockpit --board serial:/dev/ttyUSB0           a board; an idle one begins a run on its own sensors, unarmed
    plumb cockpit --board can:socketcan:can0 --watch    only watch the run that is on
    plumb cockpit --board virtual --system balancer --open-loop      prescribed motion: the outputs move nothing

Prints two addresses on this machine, and serves them until Ctrl-C: a page of the first may take control, one of the
second only watches. The page that armed the board holds it: when the page is closed, hidden, or silent for 0.3 s, the
board is disarmed. Every page stops the board: Space, Esc, or the button. A run in progress, and a board that the arm
switch or another host armed, are only watched. Nothing is fetched from a network.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from plumb.boards.link import LinkBoard
    from plumb.cockpit.board_run import PlantOnBoard
    from plumb.cockpit.page_server import PageServer

SWITCH_S = 0.001
"""Longest time that the thread of a simulated board keeps that of the pages from a heartbeat."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    parser.add_argument("--watch", action="store_true", help="only watch: begin nothing, write nothing")
    parser.add_argument(
        "--port", type=whole_number, default=0, metavar="N", help="port of the page (default: a free one)"
    )
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--out", type=Path, default=Path("recordings"), metavar="DIR", help="for recordings (default: recordings)"
    )
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    options.add_open_loop(parser)
    options.add_json(parser, " with the addresses, at the start")


def main(arguments: argparse.Namespace) -> int:
    check_page(arguments)
    with options.linked_board_of(arguments) as board:
        serve(arguments, board)
    return 0


def check_page(arguments: argparse.Namespace) -> None:
    """Raises UsageError for wrong options of a page, and without what serves it."""
    from plumb.errors import UsageError
    from plumb.extras import install_hint
    from plumb.files import whole_files

    options.check_duration(arguments.seconds)
    if not 0 <= arguments.port <= 65535:
        raise UsageError(f"--port {arguments.port}: give a number from 1 to 65535")
    there = next((path for path in (arguments.out, *arguments.out.parents) if os.path.lexists(path)), Path())
    if not there.is_dir():
        raise UsageError(f"cannot record in {arguments.out}: {there} is no folder; choose another with --out")
    whole_files.require_writable(arguments.out / "flight.plog", "choose another folder with --out")
    try:
        import aiohttp  # noqa: F401
    except ImportError:
        raise UsageError(f"the page needs aiohttp; install it {install_hint('cockpit')}") from None


def serve(arguments: argparse.Namespace, board: LinkBoard) -> None:
    """Serve the page until Ctrl-C, or for --seconds."""
    from plumb.cockpit.board_loop import BoardLoop
    from plumb.cockpit.hold import Hold
    from plumb.cockpit.page_server import PageServer
    from plumb.process_signals import endings, raise_ending

    identity = board.session.identity or board.session.connect()
    if identity.mismatch:
        print(f"plumb: warning: {identity.mismatch}", file=sys.stderr)
    plant = plant_of(arguments, board)
    loop = BoardLoop(
        board,
        Hold(),
        folder=arguments.out,
        plant=plant,
        watch=arguments.watch,
        paced=plant is not None,
        reopen=None if plant is not None else lambda: options.linked_board_of(arguments),
        command=getattr(arguments, "command_line", ""),
    )
    with endings() as caught, PageServer(loop, arguments.port) as server:
        announce(arguments, "cockpit", server.control_address, server.watch_address)
        loop.run(stopping(arguments, server, caught))
    if caught:
        raise_ending(caught)


def stopping(arguments: argparse.Namespace, server: PageServer, caught: Sequence[int]) -> Callable[[], bool]:
    """A function that is true when the command is to end: by a signal, or after --seconds from now. Raises what made
    the server fail. From now on threads take turns often, so that a page does not wait for the loop."""
    import time

    sys.setswitchinterval(SWITCH_S)
    begin_s = time.monotonic()

    def stopped() -> bool:
        if server.failed is not None:
            raise server.failed
        late = arguments.seconds is not None and time.monotonic() - begin_s >= arguments.seconds
        return bool(caught) or late

    return stopped


def announce(arguments: argparse.Namespace, what: str, control: str, watch: str) -> None:
    """Print the addresses of what is served, and open the first if that is asked for."""
    import json

    if arguments.json:
        print(json.dumps({"control": control, "watch": watch}), flush=True)
    else:
        print(f"{what}: {control}\nto watch only: {watch}\nCtrl-C ends it", flush=True)
    if arguments.open:
        import webbrowser

        if not webbrowser.open(control):
            print("plumb: no browser was found here: open the address in one", file=sys.stderr)


def plant_of(arguments: argparse.Namespace, board: LinkBoard) -> PlantOnBoard | None:
    """The plant for the pins of a board simulated in this process; None for another board."""
    from plumb.errors import UsageError

    if board.name != "virtual":
        if arguments.system or arguments.scenario or arguments.open_loop:
            remedy = "`plumb params tuning SYSTEM` makes another board that system"
            raise UsageError(
                f"--system, --scenario and --open-loop are for --board virtual, whose pins a plant drives; {remedy}"
            )
        return None
    from plumb.boards.plant_on_pins import PlantOfRuns

    system = arguments.system or board.session.system
    return PlantOfRuns(system, arguments.scenario, arguments.seed, open_loop=arguments.open_loop)

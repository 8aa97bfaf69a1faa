"""Open a live page of a board: plots, attitude, health, and a light that is green while every bit equals the model.

    plumb cockpit --board virtual                       the simulated board with its plant; arm it from the page
    plumb cockpit --board serial:/dev/ttyUSB0           a board; an idle one begins a run on its own sensors, unarmed
    plumb cockpit --board can:socketcan:can0 --watch    only watch the run that is on
    plumb cockpit --board virtual --system balancer --open-loop      prescribed motion: the outputs move nothing
    plumb cockpit --port native                         the same main loop built for this machine, where it is too slow
                                                        to simulate the chip; a number is the port of the page

Prints two addresses on this machine, and serves them until Ctrl-C: a page of the first may take control, one of the
second only watches. The page that armed the board holds it: when the page is closed, hidden, or silent for 0.3 s, the
board is disarmed. Every page stops the board: Space, Esc, or the button. A run in progress, and a board that the arm
switch or another host armed, are only watched. Page and terminal say which board runs, and at what share of real time.
Nothing is fetched from a network.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.boards.link import LinkBoard
    from plumb.cockpit.board_loop import PlantOnBoard
    from plumb.cockpit.page_server import PageServer

NATIVE = "native"
BOARD_PORTS = ("f103", NATIVE)
SWITCH_S = 0.001
"""Longest time that the thread of a simulated board keeps that of the pages from a heartbeat."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    parser.add_argument("--watch", action="store_true", help="only watch: begin nothing, write nothing")
    parser.add_argument(
        "--port",
        action=_Port,
        metavar="N|f103|native",
        help="N: port of the page (default: a free one). f103, native: of `virtual`, the chip or a board in memory",
    )
    parser.set_defaults(page_port=0, board_port="")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--out", type=Path, default=Path("recordings"), metavar="DIR", help="for recordings (default: recordings)"
    )
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    options.add_open_loop(parser)
    options.add_json(parser, " with the addresses, at the start")


class _Port(argparse.Action):
    """A number is the port of the page, a name the port of the firmware that `virtual` runs, as `plumb virtual-board
    --port` has it. A name chooses the board `virtual` where none is named."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, option: str | None = None
    ) -> None:
        given = str(values)
        if given in BOARD_PORTS:
            namespace.board_port = given
            if namespace.board is None:
                namespace.board = options.VIRTUAL
        elif given.isascii() and given.isdigit():
            namespace.page_port = int(given)
        else:
            parser.error(f"--port {given}: give a number for the page, or {' or '.join(BOARD_PORTS)} for the board")


def check_port(arguments: argparse.Namespace) -> None:
    """Raises UsageError for a port that there is not, or not with these options."""
    from plumb.errors import UsageError

    if not 0 <= arguments.page_port <= 65535:
        raise UsageError(f"--port {arguments.page_port}: give a number from 1 to 65535")
    if arguments.board_port and arguments.board != options.VIRTUAL:
        raise UsageError(f"--port {arguments.board_port} is for board {options.VIRTUAL}: leave one of them out")
    if arguments.board_port == NATIVE and getattr(arguments, "of_virtual", None):
        raise UsageError(f"{arguments.of_virtual} is for --port f103: leave it out, or leave --port native out")


def system_of_native(arguments: argparse.Namespace) -> str:
    """The system of --system, else that of factory parameters."""
    from plumb.spec import declarations
    from plumb.spec.parameters import table

    return str(arguments.system or declarations.name_of(int(table()[0].default)))


def native_of(arguments: argparse.Namespace) -> LinkBoard:
    """The main loop on a board in memory."""
    from plumb.boards.native_port import NativePort

    return NativePort(system_of_native(arguments), None)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.extras import install_hint

    options.check_duration(arguments.seconds)
    check_port(arguments)
    try:
        import aiohttp  # noqa: F401
    except ImportError:
        raise UsageError(f"the cockpit needs aiohttp; install it {install_hint('cockpit')}") from None
    with native_of(arguments) if arguments.board_port == NATIVE else options.linked_board_of(arguments) as board:
        serve(arguments, board)
    return 0


def serve(arguments: argparse.Namespace, board: LinkBoard) -> None:
    """Serve the page until Ctrl-C, or for --seconds."""
    import time

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
        tell=say,
    )
    sys.setswitchinterval(SWITCH_S)
    begin_s = time.monotonic()

    def stopped() -> bool:
        if server.failed is not None:
            raise server.failed
        late = arguments.seconds is not None and time.monotonic() - begin_s >= arguments.seconds
        return bool(caught) or late

    with endings() as caught, PageServer(loop, arguments.page_port) as server:
        announce(arguments, board, server)
        loop.run(stopped)
    if caught:
        raise_ending(caught)


def say(text: str) -> None:
    print(f"plumb: {text}", file=sys.stderr, flush=True)


def announce(arguments: argparse.Namespace, board: LinkBoard, server: PageServer) -> None:
    """Print which board runs, and the addresses; open the first if that is asked for."""
    import json

    control, watch, runs_on = server.control_address, server.watch_address, board.runs_on or board.name
    if arguments.json:
        print(json.dumps({"control": control, "watch": watch, "board": runs_on}), flush=True)
    else:
        print(f"cockpit: {control}\nto watch only: {watch}\nthe board: {runs_on}; Ctrl-C ends it", flush=True)
    if arguments.open:
        import webbrowser

        webbrowser.open(control)


def plant_of(arguments: argparse.Namespace, board: LinkBoard) -> PlantOnBoard | None:
    """The plant for the pins of a board simulated in this process; None for another board."""
    from plumb.errors import UsageError

    if arguments.board_port == NATIVE:
        from plumb.boards.native_port import PlantOfNativeRuns

        system = system_of_native(arguments)
        return PlantOfNativeRuns(system, arguments.scenario, arguments.seed, open_loop=arguments.open_loop)
    if board.name != options.VIRTUAL:
        if arguments.system or arguments.scenario or arguments.open_loop:
            remedy = "`plumb params tuning SYSTEM` makes another board that system"
            raise UsageError(
                f"--system, --scenario and --open-loop are for --board virtual, whose pins a plant drives; {remedy}"
            )
        return None
    from plumb.boards.plant_on_pins import PlantOfRuns

    system = arguments.system or board.session.system
    return PlantOfRuns(system, arguments.scenario, arguments.seed, open_loop=arguments.open_loop)

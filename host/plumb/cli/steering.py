"""Common part of `plumb fly` and `plumb ride`: a simulated vehicle steered in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options
from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.cockpit.steering.trip_loop import TripLoop

BOARDS = ("native", "virtual")


def add_arguments(
    parser: argparse.ArgumentParser, command: str, *, does: str, done: str, trips: str, seeded: str
) -> None:
    """command: also the part of a system that has it; does, done, trips: `flies`, `flown`, `flights`; seeded: what the
    seed draws."""
    options.add_system_with(parser, command, f"system that is {done}")
    parser.add_argument("--board", choices=BOARDS, default=BOARDS[0], help=f"what {does} it (default: native)")
    options.add_image(parser, "flash image of `virtual`")
    options.add_gdb(parser, f"for `virtual`; {options.GDB_ANY_TIME}")
    parser.add_argument(
        "--port", type=whole_number, default=0, metavar="N", help="port of the page (default: a free one)"
    )
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--out", type=Path, default=Path(trips), metavar="DIR", help=f"for records and reports (default: {trips})"
    )
    options.add_seed(parser, seeded)
    options.add_duration(parser)
    options.add_json(parser, f" with the addresses, at the start, and what was {done}, at the end")


def steer(arguments: argparse.Namespace, command: str) -> int:
    """Serve the page of the command's vehicle until Ctrl-C, or for --seconds."""
    from plumb.boards.debugging import debugged
    from plumb.cli.cockpit import check_page
    from plumb.cockpit.hold import Hold
    from plumb.cockpit.steering.trip_loop import PICTURE_S, TripLoop
    from plumb.errors import UsageError

    check_page(arguments)
    if arguments.image is not None and arguments.board != BOARDS[1]:
        raise UsageError("--image is for board virtual: name it with --board, or leave --image out")
    if arguments.gdb is not None and arguments.board != BOARDS[1]:
        raise UsageError("--gdb is for board virtual: name it with --board, or leave --gdb out")
    with debugged(arguments.gdb):
        trip = TripLoop(
            options.system_with(arguments, command),
            arguments.seed,
            Hold(PICTURE_S),
            folder=arguments.out,
            command=getattr(arguments, "command_line", ""),
            board=arguments.board,
            image=arguments.image,
        )
        try:
            _serve(arguments, command, trip)
        finally:
            trip.close()
    return 0


def _serve(arguments: argparse.Namespace, command: str, trip: TripLoop) -> None:
    import functools

    from plumb.boards import debugging
    from plumb.cli.cockpit import announce, stopping
    from plumb.cockpit.page_server import PageServer
    from plumb.cockpit.steering.trip_page import ASSETS, TripPage
    from plumb.process_signals import endings, raise_ending

    opened = functools.partial(TripPage, trip)
    with endings() as caught, PageServer(trip, arguments.port, assets=ASSETS, opened=opened) as server:
        announce(arguments, command, server.control_address, server.watch_address)
        stopped = stopping(arguments, server, caught)
        debugging.ends(stopped)
        trip.run(stopped)
        trip.close()
        _print_summary(arguments, trip)
    if caught:
        raise_ending(caught)


def _print_summary(arguments: argparse.Namespace, trip: TripLoop) -> None:
    """How many trips there were, how fast, and where they are recorded."""
    import json

    speed = round(trip.speed, 2)
    reports = [str(path) for path in trip.reports]
    trips = f"{trip.noun}s"
    if arguments.json:
        print(json.dumps({"board": arguments.board, trips: trip.trips, "speed": speed, "reports": reports}))
        return
    print(f"{trip.trips} {trips} on the {arguments.board} board, at {speed:.0%} of real time")
    for report in reports:
        print(f"report: {report}")

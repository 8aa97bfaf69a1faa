"""Fly a system's simulated vehicle in the browser, by keyboard or gamepad.

    plumb fly                                   prints an address, and flies there; --open opens it in the browser
    plumb fly --system quadrotor --seed 7       other errors of the sensors, another wind
    plumb fly --out flights                     where the records of the flights go (default: flights)
    plumb fly --board virtual                   the flash image on the simulated chip flies, in steps of 5 ms

The firmware, as built for this machine, flies the simulated vehicle in real time. The sticks of the page become CRSF
bytes on the line of the board's radio receiver. A page that is closed, hidden or hangs is a receiver that is lost. The
simulated chip takes more of this machine: a flight that is slower than real time says so, on the page and at the end.
Every flight is recorded, and has a report; `plumb replay` gives the record back to the bit. Runs until Ctrl-C, or for
--seconds. A second address watches. Nothing is fetched from a network.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.cockpit.flight.flight_loop import FlightLoop

PART = "steered"
BOARDS = ("native", "virtual")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_system_with(parser, PART, "system that is flown")
    parser.add_argument("--board", choices=BOARDS, default=BOARDS[0], help="what flies it (default: native)")
    options.add_image(parser, "flash image of `virtual`")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="port of the page (default: a free one)")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--out", type=Path, default=Path("flights"), metavar="DIR", help="for records and reports (default: flights)"
    )
    options.add_seed(parser, "sensors and wind")
    options.add_duration(parser)
    options.add_json(parser, " with the addresses, at the start, and what was flown, at the end")


def main(arguments: argparse.Namespace) -> int:
    from plumb.cli.cockpit import check_page
    from plumb.cockpit.flight.flight_loop import PICTURE_S, FlightLoop
    from plumb.cockpit.hold import Hold
    from plumb.errors import UsageError

    check_page(arguments)
    if arguments.image is not None and arguments.board != BOARDS[1]:
        raise UsageError("--image is for board virtual: name it with --board, or leave --image out")
    system = options.system_with(arguments, PART)
    command = getattr(arguments, "command_line", "")
    flight = FlightLoop(
        system,
        arguments.seed,
        Hold(PICTURE_S),
        folder=arguments.out,
        command=command,
        board=arguments.board,
        image=arguments.image,
    )
    try:
        _serve(arguments, flight)
    finally:
        flight.close()
    return 0


def _serve(arguments: argparse.Namespace, flight: FlightLoop) -> None:
    """Serve the page until Ctrl-C, or for --seconds."""
    import functools

    from plumb.cli.cockpit import announce, stopping
    from plumb.cockpit.flight.flight_page import ASSETS, FlightPage
    from plumb.cockpit.page_server import PageServer
    from plumb.process_signals import endings, raise_ending

    opened = functools.partial(FlightPage, flight)
    with endings() as caught, PageServer(flight, arguments.port, assets=ASSETS, opened=opened) as server:
        announce(arguments, "fly", server.control_address, server.watch_address)
        flight.run(stopping(arguments, server, caught))
        flight.close()
        _tell(arguments, flight)
    if caught:
        raise_ending(caught)


def _tell(arguments: argparse.Namespace, flight: FlightLoop) -> None:
    """What was flown, how fast, and where it is recorded."""
    import json

    speed = round(flight.speed, 2)
    reports = [str(path) for path in flight.reports]
    if arguments.json:
        said = {"board": arguments.board, "flights": flight.flights, "speed": speed, "reports": reports}
        print(json.dumps(said))
        return
    print(f"{flight.flights} flights on the {arguments.board} board, at {speed:.0%} of real time")
    for report in reports:
        print(f"report: {report}")

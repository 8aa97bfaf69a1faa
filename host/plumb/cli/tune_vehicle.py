"""`plumb tune vehicle`: thrust of a hover and drag of a vehicle from a recorded flight, and onto a board."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.proof.report import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="LOG", help="log of a flight")
    parser.add_argument("--write", action="store_true", help="set them on --board, disarmed, and save")
    parser.add_argument("--board", metavar="B", help=f"board that is written: {options.LINKED_BOARD}")
    options.add_link_and_image(parser)


def found(arguments: argparse.Namespace) -> tuple[dict[str, float], str, list[Table], dict[str, object]]:
    """Settings by whole name; lead, tables and JSON of the report. Raises UsageError for a flight that determines too
    little."""
    from plumb import systems
    from plumb.analyses.identification import flown_loop, vehicle_fit, vehicle_page
    from plumb.errors import UsageError

    if arguments.write != (arguments.board is not None):
        raise UsageError("--write and --board B go together")
    known = flown_loop.known_steps(arguments.recording)
    system = known.params.system
    part = systems.load(system, vehicle_fit.FLOWN_VEHICLE)
    fit = vehicle_fit.fit(part.vehicle(known.params, known.raw, known.setpoint))
    settings = part.settings(fit)
    lead = vehicle_page.lead(arguments.recording.name, system, fit)
    tables, document = vehicle_page.tables(fit, settings), vehicle_page.to_json(system, fit, settings)
    return settings, lead, tables, document


def write(arguments: argparse.Namespace, settings: Mapping[str, float]) -> None:
    """Set them on the board and save. Raises UsageError and LinkError; an armed board is not written."""
    from plumb.api.parameters import Parameters

    with options.linked_board_of(arguments) as board:
        parameters = Parameters(board.session)
        parameters.update(settings)
        parameters.save()

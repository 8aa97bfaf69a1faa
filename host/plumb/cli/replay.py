"""Run a recording of a real three-axis sensor through a board, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/inputs/recording.py. An ideal sensor is scaled to
the recording, resampled to the period. Where the recording has an optical reference the tilt error is reported, over
the samples marked as movement. Exit code 1 on a mismatch.

--system says what is made of it: one axis, as --axis chooses, or the attitude of the whole sensor. The page of a system
says which further files it reads; of several runs in a file the longest is taken.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from plumb.cli import options
from plumb.spec.system_parts import Part

if TYPE_CHECKING:
    from plumb.proof.runs import RunInputs
    from plumb.tuning.quantise import ControlParams


class Replayed(Protocol):
    """replay.py of a system: recordings of real sensors as inputs of a run."""

    def inputs_of(self, arguments: argparse.Namespace, /) -> tuple[RunInputs, ControlParams, Mapping[str, object]]:
        """Inputs, parameters, and the heading of the summary; arguments: those of this command."""


REPLAY = Part[Replayed]("replay", Replayed, without="no recording can be made its inputs")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    options.add_system_with(parser, REPLAY.name, "whose inputs are made of it")
    parser.add_argument("--axis", choices=("x", "y", "z"), default="x", help="where one axis is taken (default x)")
    options.add_board(parser)
    options.add_link_and_image(parser)
    parser.add_argument("--period-us", type=int, help="control period (default: the recording's own)")
    options.add_seconds(parser, "only the first N seconds")
    options.add_out(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems
    from plumb.cli.run_summary import report
    from plumb.proof import runs

    system = options.system_with(arguments, REPLAY.name)
    inputs, params, heading = systems.load(system, REPLAY).inputs_of(arguments)
    options.tell_default(arguments, system, REPLAY.name)
    with options.board_of(arguments) as board:
        result = runs.open_loop(board, inputs, params)
    summary = result.summary(
        system=system,
        **heading,
        loop="open",
        board=arguments.board,
        link=options.link_of(arguments),
        seed=None,
        scored_steps=int(inputs.scored.sum()),
    )
    return report(arguments, result, summary)

"""Run a recording of a real three-axis sensor through a board, one axis, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/inputs/recording.py. An ideal sensor is scaled to
the recording, resampled to the period. Where the recording has an optical reference the tilt error is reported, over
the samples marked as movement. Exit code 1 on a mismatch.

With --system phone, pitch and roll of the whole sensor; FILE may then also hold the datagrams of a phone's app, one a
line, as `plumb phone --save` writes them. Of several runs in a file the longest is taken.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from plumb import systems

    parser.add_argument("file", type=Path, help="the recording")
    able = systems.with_part("replay")
    parser.add_argument(
        "--system",
        choices=able,
        default=able[0] if able else None,
        help="whose inputs are made of it (default: the first of these)",
    )
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

    inputs, params, heading = systems.load(arguments.system, "replay").inputs_of(arguments)
    with options.board_of(arguments) as board:
        result = runs.open_loop(board, inputs, params)
    summary = result.summary(
        system=arguments.system,
        **heading,
        loop="open",
        board=arguments.board,
        link=options.link_of(arguments),
        seed=None,
        scored_steps=int(inputs.scored.sum()),
    )
    return report(arguments, result, summary)

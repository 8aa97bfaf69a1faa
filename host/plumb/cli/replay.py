"""Run a recording of a real three-axis sensor through a board, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/inputs/recording.py. An ideal sensor is scaled to
the recording, resampled to the period. Where the recording has an optical reference the tilt error is reported, over
the samples marked as movement. Exit code 1 on a mismatch.

--system says what is made of it: one axis, as --axis chooses, or the attitude of the whole sensor. The page of a system
says which further files it reads; of several runs in a file the longest is taken.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from plumb.cli import options

PART = "replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    options.add_system_with(parser, PART, "whose inputs are made of it")
    parser.add_argument("--axis", choices=("x", "y", "z"), default="x", help="where one axis is taken (default x)")
    options.add_board(parser)
    options.add_link_and_image(parser)
    parser.add_argument("--period-us", type=int, help="control period (default: the recording's own)")
    options.add_seconds(parser, "only the first N seconds")
    options.add_out(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.cli.run_summary import report
    from plumb.inputs import replay

    system = options.system_with(arguments, PART)
    request = replay.ReplayRequest(arguments.file, arguments.axis, arguments.period_us, arguments.seconds)
    prepared = replay.prepare(system, request)
    options.tell_default(arguments, system, PART)
    for sentence in prepared.warnings:
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    with options.board_of(arguments) as board:
        done = prepared.run(board, arguments.board, options.link_of(arguments))
    return report(arguments, done.run, done.summary())

"""Run a recording of a real three-axis sensor through a board, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/inputs/recording.py. The recording is resampled to
the period and converted to the counts of an ideal sensor. If it has an optical reference, the tilt error over the
samples marked as movement is reported. Exit code 1 on a mismatch.

--system chooses the estimator: one axis of the sensor, which --axis selects, or its whole attitude. The page of a
system names further file formats that it reads; of several runs in a file the longest is used.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from plumb.cli import options

PART = "replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    options.add_system_with(parser, PART, "system that replays the recording")
    parser.add_argument(
        "--axis", choices=("x", "y", "z"), default="x", help="axis of the sensor, for one-axis systems (default x)"
    )
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

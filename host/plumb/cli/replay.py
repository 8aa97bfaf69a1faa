"""Run a recording of a real three-axis sensor through a board, one axis, and compare every step with the model.

FILE is .npz or .csv; the columns are described at the top of plumb/inputs/recording.py. An ideal sensor is scaled to
the recording, resampled to the period. Where the recording has an optical reference the tilt error is reported, over
the samples marked as movement. Exit code 1 on a mismatch.

With --system phone, pitch and roll of the whole sensor; FILE may then also hold the datagrams of a phone's app, one a
line, as `plumb phone --save` writes them. Of several runs in a file the longest is taken.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path


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
    parser.add_argument("--board", required=True, metavar="B", help="native, qemu, virtual, serial:PORT or can:BUS")
    parser.add_argument("--link", choices=("serial", "can"), default="serial", help="how `virtual` is spoken to")
    parser.add_argument("--image", type=Path, help="flash image for `virtual` (default: the checkout's build)")
    parser.add_argument("--period-us", type=int, help="control period (default: the recording's own)")
    parser.add_argument("--seconds", type=float, help="only the first so many seconds")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/report.html, summary.json and steps.csv")
    parser.add_argument("--json", action="store_true", help="print JSON")


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems
    from plumb.boards import open_board
    from plumb.cli.run import describe
    from plumb.proof import runs

    inputs, params, heading = systems.load(arguments.system, "replay").inputs_of(arguments)
    with open_board(arguments.board, link=arguments.link, image=arguments.image) as board:
        result = runs.open_loop(board, inputs, params)
    summary = result.summary(
        system=arguments.system,
        **heading,
        loop="open",
        board=arguments.board,
        link=arguments.link if arguments.board == "virtual" else None,
        seed=None,
        scored_steps=int(inputs.scored.sum()),
    )
    if arguments.out:
        from plumb.proof import run_report

        run_report.write_run(arguments.out, result, summary)
    print(json.dumps(summary) if arguments.json else describe(summary))
    return {"pass": 0, "fail": 1, "unverified": 3}[result.verdict]

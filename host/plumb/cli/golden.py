"""Make the golden vectors from their recipe, or check boards against them.

    plumb golden check --board native --board qemu --board virtual      every system, without hardware
    plumb golden check --board virtual --link can --system balancer     one system, over CAN
    plumb golden check --board serial:/dev/ttyUSB0                      silicon
    plumb golden make                                                   after a change of the specification

The integer model makes the vectors; a board passes when it gives the same digest at every step. The model itself,
`fixed`, is always checked too. fixed, native and qemu take every vector, a board behind a link those that the recipe
marks for it. A damaged file, or one that differs from recipe or manifest, is refused before anything runs. A difference
is traced to the first step and signal. Exit code 1 on a mismatch, 3 when the link lost digests or raw counts.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=("make", "check"))
    options.add_boards(parser, default="native")
    options.add_systems(parser, "only this system's vectors")
    options.add_link_and_image(parser)
    parser.add_argument("--vectors", type=Path, help="folder of the vectors (default: the checkout's tests/vectors)")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import exit_code_of
    from plumb.link.endpoint_names import parse_board
    from plumb.proof import golden

    folder = golden.vectors_folder(arguments.vectors)
    if arguments.action == "make":
        made = golden.make(folder, arguments.system)
        print(json.dumps({"made": made}) if arguments.json else "\n".join(made))
        return 0
    boards = dict.fromkeys(["fixed", *(arguments.board or ["native"])])
    for spec in boards:
        parse_board(spec)  # a wrong name is refused before any vector runs
    cases = golden.cases(folder, arguments.system)
    results = {}
    for spec in boards:
        with options.board_of(arguments, spec) as board:
            results[spec] = golden.check(board, folder, chosen=cases)
    verdict = golden.verdict_of(results.values())
    if arguments.json:
        print(json.dumps({"verdict": verdict, "boards": {spec: result.to_json() for spec, result in results.items()}}))
    else:
        for spec, result in results.items():
            print(f"{spec}: {result.describe()}")
        print(verdict)
    return exit_code_of(verdict)

"""Make the golden vectors from their recipe, or check boards against them.

    plumb golden check --board native --board qemu --board virtual      every system, without hardware
    plumb golden check --board virtual --link can --system balancer     one system, over CAN
    plumb golden check --board serial:/dev/ttyUSB0                      silicon
    plumb golden make                                                   after a change of the specification

The vectors are data made by the integer model; a board passes when every step's digest is the same. The model itself,
`fixed`, is always checked beside the boards asked for. fixed, native and qemu take every vector, a link those that the
recipe marks for it. A file that is damaged, or is not what recipe and manifest say, is refused before anything runs. A
difference is traced to the first step and signal. Exit code 1 on a mismatch, 3 when
a link lost what would have proved it.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=("make", "check"))
    parser.add_argument(
        "--board",
        action="append",
        metavar="B",
        help="native, qemu, virtual, serial:PORT or can:BUS; repeatable (default: native)",
    )
    parser.add_argument("--system", action="append", metavar="S", help="only this system's vectors; repeatable")
    parser.add_argument("--link", choices=("serial", "can"), default="serial", help="how `virtual` is spoken to")
    parser.add_argument("--image", type=Path, help="flash image for `virtual` (default: the checkout's build)")
    parser.add_argument("--vectors", type=Path, help="folder of the vectors (default: the checkout's tests/vectors)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards import open_board
    from plumb.proof import golden

    folder = golden.vectors_folder(arguments.vectors)
    if arguments.action == "make":
        made = golden.make(folder, arguments.system)
        print(json.dumps({"made": made}) if arguments.json else "\n".join(made))
        return 0
    cases = golden.cases(folder, arguments.system)
    results = {}
    for spec in dict.fromkeys(["fixed", *(arguments.board or ["native"])]):
        with open_board(spec, link=arguments.link, image=arguments.image) as board:
            results[spec] = golden.check(board, folder, chosen=cases)
    verdict = golden.verdict_of(results.values())
    if arguments.json:
        print(json.dumps({"verdict": verdict, "boards": {spec: result.to_json() for spec, result in results.items()}}))
    else:
        for spec, result in results.items():
            print(f"{spec}: {result.describe()}")
        print(verdict)
    return {"pass": 0, "fail": 1, "unverified": 3}[verdict]

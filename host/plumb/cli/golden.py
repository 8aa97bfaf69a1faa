"""Make the golden vectors from their recipe, or check boards against them.

    plumb golden check --board native --board qemu --board virtual      every system, without hardware
    plumb golden check --board qemu:m0 --board qemu:m4 --board qemu:m7  the core as code for other processors
    plumb golden check --board virtual --image mine.bin                 your build of the firmware
    plumb golden check --board "program:./port"                         your port of the C core
    plumb golden check --board virtual --link can --system balancer     one system, over CAN
    plumb golden check --board serial:/dev/ttyUSB0 --vector 'quad_*'    silicon, some vectors
    plumb golden check --junit golden.xml --github --html golden.html   for a CI job
    plumb golden make                                                   after a change of the specification

The integer model makes the vectors; a board passes when it gives the same digest at every step. The model itself,
`fixed`, is always checked, too. fixed, native, qemu and program run every vector, a board behind a link only those that
the recipe marks for it. A damaged file, or one that differs from recipe or manifest, is refused before anything runs.
Every difference is traced to its first step and signal. Exit code 1 on a mismatch, 3 when the link lost digests or
counts.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=("make", "check"))
    options.add_boards(parser, default="native", also="qemu:m0, qemu:m3, qemu:m4, qemu:m7, program:COMMAND")
    options.add_systems(parser, "only this system's vectors")
    parser.add_argument(
        "--vector", action="append", metavar="NAME", help="check only this vector; * and ? as in file names; repeatable"
    )
    options.add_link_and_image(parser)
    parser.add_argument(
        "--vectors", type=Path, help="folder of the vectors (default: the checkout's tests/vectors, else the package's)"
    )
    parser.add_argument("--verbose", action="store_true", help="a line for every vector, also for those that pass")
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML: a test case per board and vector")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page with a plot of each first divergence")
    parser.add_argument("--github", action="store_true", help="print annotations for GitHub Actions")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.boards.preconditions import require_boards
    from plumb.errors import UsageError, exit_code_of
    from plumb.proof import golden, golden_checks
    from plumb.proof.golden_github import workflow_commands

    folder = golden.vectors_folder(arguments.vectors)
    if arguments.action == "make":
        if arguments.vector:
            raise UsageError("--vector is for `plumb golden check`; --system chooses what is made")
        made = golden.make(folder, arguments.system)
        print(json.dumps({"made": made}) if arguments.json else "\n".join(made))
        return 0
    boards = dict.fromkeys(["fixed", *(arguments.board or ["native"])])
    options.check_of_virtual(arguments, *boards)
    require_boards(list(boards), arguments.image)  # before any vector runs
    golden_checks.require_places(path for path in (arguments.junit, arguments.html) if path)
    cases = golden.cases(folder, arguments.system, arguments.vector)
    checks = golden_checks.check_boards(
        lambda spec: options.board_of(arguments, spec), boards, cases, windows=arguments.html is not None
    )
    command = getattr(arguments, "command_line", "")
    golden_checks.write_reports(checks, arguments.junit, arguments.html, command)
    if arguments.github:
        for line in workflow_commands(checks.results, checks.errors, folder):
            print(line, file=sys.stderr if arguments.json else sys.stdout)
    if checks.trouble:
        raise checks.trouble
    if arguments.json:
        print(json.dumps(checks.to_json()))
    else:
        for spec, result in checks.results.items():
            print(f"{spec}: {result.describe()}")
            for row in result.rows:
                if arguments.verbose or row.verdict != "pass":
                    print(f"  {row.describe()}")
        print(checks.verdict)
        for label, path in (("report", arguments.html), ("junit", arguments.junit)):
            if path:
                print(f"{label}: {path}")
    return exit_code_of(checks.verdict)

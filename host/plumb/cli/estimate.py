"""Make angles of a recording of a real sensor: roll, pitch, rate about the vertical, and their standard deviation.

    plumb estimate walk.csv --out walk                   walk/angles.csv and walk/report.html
    plumb estimate walk.csv --system quad --axis y       the tilt about one axis

FILE is a recording in units, as `plumb replay` takes it. The system's C step runs on an ideal 16-bit sensor at the
recording's own rate, and every column is in deg or deg/s: no integers. Where VQF is installed (package vqf), its roll
and pitch stand next to them, and those of the recording's reference, where it has one.

Axes of the body are x to the front, y to the left, z up; a positive roll lowers the right side, a positive pitch lowers
the nose. The heading is the gyro's alone and begins at 0.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from plumb.cli import checked_file, options
from plumb.cli.whole_numbers import whole_number
from plumb.errors import counted

PART, DEFAULT = "angles", "attitude"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="the recording")
    options.add_system_with(parser, PART, "system that estimates")
    parser.add_argument("--axis", choices=("x", "y", "z"), help="axis of the sensor, for one-axis systems (default x)")
    parser.add_argument("--period-us", type=whole_number, help="period of a step (default: the recording's own)")
    parser.add_argument(
        "--decimate", type=whole_number, choices=(1, 3, 6), help="means of blocks of samples (default 1: none)"
    )
    checked_file.add_as_found(parser)
    options.add_seconds(parser, "only the first N seconds")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write DIR/angles.csv and DIR/report.html")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    import json

    from plumb.analyses.estimation import page
    from plumb.analyses.estimation.estimated import estimate
    from plumb.errors import ExitCode
    from plumb.proof import report, table_text

    system = options.system_with(arguments, PART)
    loaded, checked = checked_file.load(arguments.file, arguments)
    made = estimate(system, checked_file.request(arguments, loaded))
    for sentence in made.warnings:
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    found = page.tables(made)
    if arguments.out:
        lead = f"{made.name} by {system}, {counted(len(made.time_s), 'step')} of {made.period_us} us."
        html = report.page(f"Angles of {made.name}", "", lead, [*page.plots(made), *found])
        report.write_whole(arguments.out, {"angles.csv": page.csv_text(made), "report.html": html})
    as_json = {**page.to_json(made), "check": checked_file.told(checked, arguments.as_found)}
    print(json.dumps(as_json) if arguments.json else table_text.text(found))
    if arguments.out and not arguments.json:
        print(f"every step: {arguments.out / 'angles.csv'}\nreport: {arguments.out / 'report.html'}")
    elif not arguments.json:
        print("--out DIR writes every step: DIR/angles.csv and DIR/report.html")
    return ExitCode.GOOD

"""Write a log in the formats of other tools: CSV, Parquet, BLF, ASC, candump, TRC, MF4.

    plumb export today.plog today.csv                       the steps, with units and time
    plumb export today.plog today.blf today.mf4 today.html  several files at once

The suffix of a file names its format:

    .csv .parquet              one row a step, with the units in the names: angles, motors in per cent, phase in words,
                               raw counts, sensors, and every signal of the system
    .blf .asc .log .trc        every frame, for CAN tools (.log is candump's)
    .mf4                       every frame, the DBC, and the signals in units, for ASAM tools
    .html                      the report: the signals over time, and what they were recorded with
    .dbc .json                 the DBC of the log; its identity and parameters

    plumb export flight.plog flight.csv --format bbl-csv    .csv in the columns of blackbox_decode, for blackbox viewers

LOG is a log of plumb record, also one that was cut: it is read up to its last whole block. It may be the file of a CAN
tool, too (plumb replay --help), with --params where its frames do not carry the parameters. --log-run chooses one of
several runs (default: the one of which most is known). A file that exists is not overwritten without --force.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from plumb.cli import options
from plumb.errors import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG", help="the log")
    parser.add_argument(
        "files", type=Path, nargs="+", metavar="FILE", help="file to write; its suffix names the format"
    )
    parser.add_argument(
        "--format", choices=["bbl-csv"], help=".csv files have the columns of blackbox_decode (default: plumb's own)"
    )
    options.add_log_run(parser)
    options.add_force(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.readers import log_replay
    from plumb.writers import log_export

    log_export.require(arguments.files, replace=arguments.force, blackbox=bool(arguments.format))
    log = log_replay.open_log(arguments.log)
    for sentence in log.warnings:
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    chosen = None
    try:
        runs = log_replay.runs_of(log, options.params_of(arguments))
        chosen = log_replay.chosen(runs, arguments.log_run)
    except UsageError:
        if arguments.log_run is not None or any(log_export.needs_run(path) for path in arguments.files):
            raise
    for path in arguments.files:
        log_export.export(log, chosen, path, blackbox=bool(arguments.format))
    summary = {
        "log": str(arguments.log),
        "frames": log.count,
        "run": None if chosen is None else chosen.number,
        "runs": 0 if chosen is None else chosen.of,
        "steps": 0 if chosen is None else chosen.run.steps,
        "files": [str(path) for path in arguments.files],
    }
    if arguments.json:
        print(json.dumps(summary))
        return 0
    of = "" if chosen is None else f", run {chosen.number} of {chosen.of} with {counted(chosen.run.steps, 'step')}"
    print(f"{arguments.log}: {counted(log.count, 'frame')}{of}")
    for path in arguments.files:
        print(f"file: {path}")
    return 0

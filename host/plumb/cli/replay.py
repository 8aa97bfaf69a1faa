"""Run a recording through a board, and compare every step with the model.

    plumb replay today.plog --board virtual              reproduce what plumb record recorded, bit for bit
    plumb replay bus.blf --board native                  the same from a file of frames that carry raw counts
    plumb replay walk.csv --axis y --board native        a recording of a real sensor, in units

A log (.plog), or the frames of a CAN tool, carry the raw counts that the board used, and the digest of what it made of
them. BLF, ASC, TRC, MF4, what candump logs or prints, BusMaster's log, python-can's CSV and SavvyCAN's (GVRET) are told
by their content, also when compressed by gzip. A file that is cut is read up to its last whole line. The counts go
through --board and through the model, and all three answers are compared: `pass` says that recording, board and model
agree in every bit. From a step on whose counts were lost, nothing is verified (exit code 3). Parameters are those of
the recording; --params gives them where its frames do not carry them.

A recording in units (.npz, .csv) is replayed with an ideal sensor that is scaled to it. That compares the board with
the model on new counts; it is no proof of what another board did with this motion. Columns are described at the top of
plumb/readers/recording.py. It is resampled to the period; --decimate first takes the means of blocks of samples, as a
sensor with a lower output rate does. With an optical reference, the tilt error over the samples marked as movement is
reported. What `plumb check` finds wrong comes first; --as-found undoes what is sure. --system chooses the estimator:
one axis of the sensor, which --axis selects, or its whole attitude. The page of a system names further file formats
that it reads; of several runs in a file the longest is used.

Exit code 1 on a mismatch.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from plumb.cli import checked_file, options
from plumb.cli.whole_numbers import whole_number

PART = "replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="the recording")
    options.add_system_with(parser, PART, "system that replays a recording in units")
    parser.add_argument(
        "--axis", choices=("x", "y", "z"), help="of units: axis of the sensor, for one-axis systems (default x)"
    )
    options.add_board(parser)
    options.add_link_and_image(parser)
    parser.add_argument(
        "--period-us", type=whole_number, help="of units: control period (default: the recording's own)"
    )
    parser.add_argument(
        "--decimate",
        type=whole_number,
        choices=(1, 3, 6),
        help="of units: means of blocks of so many samples (default 1: none)",
    )
    checked_file.add_as_found(parser)
    options.add_log_run(parser)
    options.add_seconds(parser, "only the first N seconds")
    options.add_out(parser)
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.readers import log_replay

    if log_replay.is_log(arguments.file):
        return of_log(arguments)
    return of_units(arguments)


def of_log(arguments: argparse.Namespace) -> int:
    """Reproduce a recorded run."""
    from plumb.cli.run_summary import report, require_out
    from plumb.errors import UsageError
    from plumb.readers import log_replay

    for option in ("axis", "period_us", "decimate", "as_found", "units", "columns", "frame"):
        if getattr(arguments, option) not in (None, False):
            name = f"--{option.replace('_', '-')}"
            raise UsageError(f"{name} is for recordings in units: a log is replayed as it was recorded")
    require_out(arguments)
    log = log_replay.open_log(arguments.file)
    for sentence in log.warnings:
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    recorded = log_replay.chosen(log_replay.runs_of(log, options.params_of(arguments)), arguments.log_run)
    if arguments.system not in (None, recorded.system):
        raise UsageError(
            f"{arguments.file.name} is of {recorded.system}, not of {arguments.system}: leave out --system"
        )
    if recorded.of > 1 and arguments.log_run is None:
        print(f"run {recorded.number} of {recorded.of}, of which most is known; --log-run N chooses", file=sys.stderr)
    with options.board_of(arguments) as board:
        done = log_replay.reproduce(recorded, board, arguments.board, options.link_of(arguments), arguments.seconds)
    return report(arguments, done.run, done.summary(), verdict=done.verdict, more=[done.statement()])


def of_units(arguments: argparse.Namespace) -> int:
    """Replay a recording of a real sensor in engineering units."""
    from plumb.cli.run_summary import report, require_out
    from plumb.errors import UsageError
    from plumb.readers import replay

    if arguments.log_run is not None or arguments.params is not None:
        wrong = "--log-run" if arguments.log_run is not None else "--params"
        raise UsageError(f"{wrong} is for logs: {arguments.file.name} is a recording in units")
    require_out(arguments)
    system = options.system_with(arguments, PART)
    own = replay.reads_itself(system, arguments.file)
    loaded, found = (None, None) if own else checked_file.load(arguments.file, arguments)
    prepared = replay.prepare(system, checked_file.request(arguments, loaded))
    options.print_default(arguments, system, PART)
    for sentence in prepared.warnings:
        print(f"plumb: warning: {sentence}", file=sys.stderr)
    with options.board_of(arguments) as board:
        done = prepared.run(board, arguments.board, options.link_of(arguments))
    summary = done.summary()
    if found is not None:
        summary = {**summary, "check": checked_file.told(found, arguments.as_found)}
    return report(arguments, done.run, summary, more=[prepared.statement])

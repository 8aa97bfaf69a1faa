"""Record a running board, or the frames on a bus, to a log.

    plumb record --board serial:/dev/ttyUSB0 --run live --out today --seconds 60
    plumb record --board virtual --run live --out today --seconds 10 --format csv --format blf
    plumb record --bus can:socketcan:can0 --out bus.asc

With --board, the log is today.plog: identity, image, parameters, DBC, and every frame, with the raw counts, digests and
signals of the steps. today.html shows the signals over time. --format writes further files to the same folder, as plumb
export does later: csv, parquet, blf, asc, log (candump), trc, mf4. plumb replay reproduces a log on any board. Without
--run the command only listens to the run in progress, which can be reproduced only if its beginning is in the log.

With --bus no frame is sent; the suffix of the file names its format: .plog, or .asc .blf .csv .log .trc.

A file that exists is never overwritten without --force. The recording ends after --seconds, with Ctrl-C, or when the
link breaks; what was recorded until then is kept and reported. A recorder that is killed loses at most the last 0.25 s.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.link.session import Session
    from plumb.writers.log_writer import LogWriter
    from plumb.writers.recorder import FrameLog

FORMATS = ("csv", "parquet", "blf", "asc", "log", "trc", "mf4")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    options.add_board(what, linked=True, required=False)
    what.add_argument("--bus", metavar="BUS", help=options.BUS)
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="the log (default suffix .plog)")
    parser.add_argument("--run", choices=("live",), help="begin a run on the board's own sensors, unarmed")
    parser.add_argument(
        "--format", action="append", choices=FORMATS, metavar="F", default=[],
        help=f"with --board, also write this format: {', '.join(FORMATS)}; repeatable",
    )  # fmt: skip
    options.add_force(parser)
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    options.add_json(parser, " at the end")


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.process_signals import endings, raise_ending

    options.check_duration(arguments.seconds)
    if arguments.bus and (arguments.run or arguments.format):
        wrong = "--run" if arguments.run else "--format"
        raise UsageError(f"--bus only listens: {wrong} needs --board")
    if arguments.bus:
        options.check_of_virtual(arguments)
    summary: dict[str, object] = {}
    try:
        with endings() as caught:
            if arguments.bus:
                of_bus(arguments, caught, summary)
            else:
                of_board(arguments, caught, summary)
    finally:
        if summary and arguments.json:
            print(json.dumps(summary))
        elif summary:
            written = summary.pop("files", [])
            assert isinstance(written, list)
            print(", ".join(f"{name} {value}" for name, value in summary.items()))
            for path in written:
                print(f"{'report' if path.endswith('.html') else 'file'}: {path}")
    if caught:
        raise_ending(caught)
    return 0


def log_path(arguments: argparse.Namespace) -> Path:
    """The file that --out names."""
    from plumb.readers.log_file import SUFFIX

    path: Path = arguments.out
    return path if path.suffix else path.with_name(path.name + SUFFIX)


def of_bus(arguments: argparse.Namespace, caught: list[int], summary: dict[str, object]) -> None:
    """Write every frame of the bus to the log; fills in the summary also if an error ends the recording."""
    from plumb.bridge.frame_counts import Flow
    from plumb.link.transports.open_bus import open_bus

    flow, count = Flow(), 0
    end = None if arguments.seconds is None else time.monotonic() + arguments.seconds
    with open_bus(arguments.bus, listen_only=True) as bus, bus_log(arguments) as log:
        try:
            while not caught and (end is None or time.monotonic() < end) and not getattr(bus, "ended", False):
                message = bus.recv(0.1)
                if message is None:
                    log.flush()
                    continue
                log.add_message(message)
                count += 1
                if not message.is_extended_id and not message.is_error_frame and not message.is_remote_frame:
                    flow.note(message.arbitration_id, bytes(message.data))
        finally:
            damaged = flow.rejected + int(getattr(bus, "rejected", 0)) + int(getattr(bus, "malformed", 0))
            path = str(log_path(arguments))
            summary.update(frames=count, lost=flow.lost, rejected=damaged, foreign=flow.foreign, log=path)


def bus_log(arguments: argparse.Namespace) -> LogWriter | FrameLog:
    """The log of a bus, in the format of its suffix."""
    from plumb.proof import run_identity
    from plumb.readers.log_file import SUFFIX
    from plumb.writers.log_writer import LogWriter
    from plumb.writers.recorder import FrameLog

    path = log_path(arguments)
    if path.suffix != SUFFIX:
        return FrameLog(path, replace=arguments.force)
    command = getattr(arguments, "command_line", "")
    head = run_identity.identity({"bus": arguments.bus}, None, command)
    return LogWriter(path, head, replace=arguments.force)


def of_board(arguments: argparse.Namespace, caught: list[int], summary: dict[str, object]) -> None:
    """Record a board to a log; fills in the summary also if an error ends the recording."""
    from plumb.cli.monitor import attach_plant
    from plumb.link import monitor
    from plumb.proof import run_identity
    from plumb.writers.recorder import Recorder

    path, exports = files_of(arguments)
    with options.linked_board_of(arguments) as board:
        simulated = attach_plant(board, arguments.system, arguments.scenario, arguments.seed)
        session = board.session
        head = run_identity.identity(run_identity.part_of(board), None, getattr(arguments, "command_line", ""))
        if simulated:
            head["plant"] = plant_of(arguments, session)
        recorder = Recorder(session, path, head, replace=arguments.force)
        ended = "the link broke"
        try:
            session.listener = recorder.feed
            if arguments.run:
                monitor.begin_live(session, raw_first=True)
            else:
                monitor.read_only(session)
            listen(session, arguments.seconds, caught)
            if arguments.run:
                session.end()
            session.listener = None
            ended = "interrupted" if caught else "after the time that was asked for"
        finally:
            session.listener = None
            try:
                recorder.close(ended)
            finally:
                summary.update(of_log(path, exports))
                summary.update(other_lost=session.counters.lost, rejected=session.frames.rejected)


def plant_of(arguments: argparse.Namespace, session: Session) -> dict[str, object]:
    """The motion of the sensors of a simulated board."""
    from plumb import systems
    from plumb.systems.contracts import PINS

    shown = systems.load(session.system, PINS).SHOWN
    return {"scenario": arguments.scenario or shown, "seed": arguments.seed}


def files_of(arguments: argparse.Namespace) -> tuple[Path, list[Path]]:
    """The log and the other files to be written; raises UsageError when one of them cannot be, before anything is
    recorded."""
    from plumb.errors import UsageError
    from plumb.files.block_file import exists_sentence
    from plumb.readers.log_file import SUFFIX
    from plumb.writers import log_export

    path = log_path(arguments)
    if path.suffix != SUFFIX:
        raise UsageError(f"{path}: the log of a board ends in {SUFFIX}; --format writes other formats as well")
    if path.exists() and not arguments.force:
        raise UsageError(exists_sentence(path))
    exports = [path.with_suffix(f".{name}") for name in dict.fromkeys([*arguments.format, "html"])]
    log_export.require(exports, replace=arguments.force)
    return path, exports


def of_log(path: Path, exports: list[Path]) -> dict[str, object]:
    """Write the exports of a finished log; what the summary says of it."""
    from plumb.errors import UsageError, counted
    from plumb.readers import log_replay
    from plumb.writers import log_export

    log = log_replay.open_log(path)
    runs, why = [], ""
    try:
        runs = log_replay.runs_of(log)
    except UsageError as error:
        why = str(error)
    chosen = log_replay.chosen(runs, None) if runs else None
    written = [export for export in exports if chosen is not None or not log_export.needs_run(export)]
    for export in written:
        log_export.export(log, chosen, export)
    if not runs:
        print(f"plumb: {why}", file=sys.stderr)
    elif chosen is not None and chosen.unknown:
        print(
            f"plumb: replay reproduces {chosen.known:,} of {counted(chosen.run.steps, 'step')}: {chosen.unknown}",
            file=sys.stderr,
        )
    return {
        "steps": sum(one.run.steps for one in runs),
        "lost": sum(one.run.incomplete for one in runs),
        "log": str(path),
        "files": [str(export) for export in written],
    }


def listen(session: Session, seconds: float | None, caught: list[int]) -> None:
    """Receive until `seconds` of the board's time have passed; raises LinkError when the board falls silent."""
    from plumb.link.monitor import require_frames

    begin_s = session.clock()
    while not caught and (seconds is None or session.clock() - begin_s < seconds):
        session.receive(0.05)
        require_frames(session)

"""Record a running board, or the frames on a bus.

    plumb record --board serial:/dev/ttyUSB0 --run live --out today --seconds 60
    plumb record --board virtual --run live --out today --seconds 10
    plumb record --bus can:socketcan:can0 --out bus.asc

With --board, PATH is a folder: frames.asc (every frame), steps.csv (one row per step, in engineering units), board.json
(identity and parameters of the run) and report.html (the signals over time). Without --run the command only listens to
the run in progress. With --bus, PATH is a log of frames, and no frame is sent; its suffix names the format (.asc .blf
.csv .log .trc). Ends after --seconds, with Ctrl-C, or when the link breaks; what was recorded until then is kept and
reported.
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    options.add_board(what, linked=True, required=False)
    what.add_argument("--bus", metavar="BUS", help=options.BUS)
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="folder, or with --bus the log")
    parser.add_argument("--run", choices=("live",), help="begin a run on the board's own sensors, unarmed")
    options.add_duration(parser)
    options.add_link_and_image(parser)
    options.add_plant(parser)
    options.add_json(parser, " at the end")


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.process_signals import endings, raise_ending

    options.check_duration(arguments.seconds)
    if arguments.bus and arguments.run:
        raise UsageError("--bus only listens: --run needs --board")
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
            page = summary.pop("report", None)
            print(", ".join(f"{name} {value}" for name, value in summary.items()))
            if page:
                print(f"report: {page}")
    if caught:
        raise_ending(caught)
    return 0


def of_bus(arguments: argparse.Namespace, caught: list[int], summary: dict[str, object]) -> None:
    """Write every frame of the bus to the log; fills in the summary also if an error ends the recording."""
    from plumb.inputs.frame_counts import Flow
    from plumb.inputs.recorder import FrameLog
    from plumb.link.transports.open_bus import open_bus

    flow, count = Flow(), 0
    end = None if arguments.seconds is None else time.monotonic() + arguments.seconds
    with open_bus(arguments.bus, listen_only=True) as bus, FrameLog(arguments.out) as log:
        try:
            while not caught and (end is None or time.monotonic() < end) and not getattr(bus, "ended", False):
                message = bus.recv(0.1)
                if message is None:
                    log.flush()
                    continue
                log.add(message)
                count += 1
                if not message.is_extended_id and not message.is_error_frame and not message.is_remote_frame:
                    flow.note(message.arbitration_id, bytes(message.data))
        finally:
            damaged = flow.rejected + int(getattr(bus, "rejected", 0)) + int(getattr(bus, "malformed", 0))
            summary.update(frames=count, lost=flow.lost, rejected=damaged, foreign=flow.foreign, log=str(arguments.out))


def of_board(arguments: argparse.Namespace, caught: list[int], summary: dict[str, object]) -> None:
    """Record a board into the folder; fills in the summary also if an error ends the recording."""
    from plumb import systems
    from plumb.cli.monitor import attach_plant
    from plumb.inputs import record_report
    from plumb.inputs.recorder import Recorder
    from plumb.link import monitor
    from plumb.systems.contracts import PINS

    make_folder(arguments.out)
    with options.linked_board_of(arguments) as board:
        simulated = attach_plant(board, arguments.system, arguments.scenario, arguments.seed)
        session = board.session
        command = getattr(arguments, "command_line", "")
        recorder = Recorder(session, arguments.out, record_report.identity_of(board, command))
        heading: dict[str, object] = {"system": session.system}
        if simulated:
            shown = systems.load(session.system, PINS).SHOWN
            heading |= {"scenario": arguments.scenario or shown, "seed": arguments.seed}
        try:
            session.listener = recorder.feed
            if arguments.run:
                monitor.begin_live(session)
            else:
                monitor.read_only(session)
            listen(session, arguments.seconds, caught)
            session.listener = None
            if arguments.run:
                session.end()
            elif not recorder.rows:
                print("plumb: no run was in progress: --run live begins one on the board's sensors", file=sys.stderr)
        finally:
            try:
                recorder.close()
            finally:
                summary.update(steps=recorder.rows, lost=recorder.lost, other_lost=session.counters.lost)
                summary.update(rejected=session.frames.rejected, folder=str(arguments.out))
            page = record_report.write_report(arguments.out, board, recorder.words, recorder.lost, heading, command)
            summary["report"] = str(page) if page else None


def make_folder(folder: Path) -> None:
    from plumb.errors import UsageError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"the folder {folder} cannot be created: {error.strerror}") from None


def listen(session: Session, seconds: float | None, caught: list[int]) -> None:
    """Receive until `seconds` of the board's time have passed; raises LinkError when the board falls silent."""
    from plumb.errors import LinkError
    from plumb.link.monitor import SILENCE_S

    begin_s = heard_s = session.clock()
    while not caught and (seconds is None or session.clock() - begin_s < seconds):
        if session.receive(0.05):
            heard_s = session.clock()
        elif session.clock() - heard_s > SILENCE_S:
            raise LinkError("the board fell silent: check cable and power")

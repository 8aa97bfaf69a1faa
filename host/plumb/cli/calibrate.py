"""Calibrate a board's sensors: rest bias, poses at rest, mounting, signs and scales, each with a check.

    plumb calibrate --board serial:/dev/ttyUSB0
    plumb calibrate --board serial:/dev/ttyUSB0 --undo
    plumb calibrate --board serial:board --hand hand.txt    one that `plumb virtual-board --hand hand.txt` serves
    plumb calibrate --board virtual --system quad        a simulated hand holds it
    plumb calibrate --board native --system quad         the same, the main loop in this process: faster

It asks for one pose after the other: a system with two accelerometer axes takes four, one with three takes six. A
reading that cannot be of the pose is refused with the reason: it moved, another side is up, a wire is off, samples were
lost. Then it asks for a turn about each axis, which gives the gyro's axes, signs and scales; a three-axis sensor may be
mounted any way round. The turns back and the rests at their ends, which the result does not use, show what is wrong
before and after. It asks before it commits the new parameters, and again
before it saves them in the board's flash. The board is disarmed throughout.

What was replaced is remembered by board: --undo puts it back, in any later session, one calibration at a time, and
leaves other parameters alone; `plumb params undo` knows the change, too.
--answers FILE answers the questions from a TOML file: write = true, save = false. Exit code 1 when the poses contradict
each other or the answer was not to write.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.boards.link import LinkBoard
    from plumb.calibration.axis_calibration import Calibrated
    from plumb.cli.questions import Questions
    from plumb.link.session import Session
    from plumb.tuning.pose_calibration import Pose

SIMULATED = ("virtual", "native")
NAME = "calibrate"
"""Mark of such a change in the history of a board's parameters."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True)
    options.add_system_with(parser, "poses", "system of `virtual`; another board has its own")
    options.add_link_and_image(parser)
    options.add_seed(parser, "the errors of the sensors of `virtual`")
    options.add_hand(parser)
    parser.add_argument("--undo", action="store_true", help="put back what the last calibration of this board replaced")
    parser.add_argument("--answers", type=Path, metavar="FILE", help="answer the questions from this TOML file")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.cli.questions import questions

    asked = questions(arguments.answers)
    board, put = opened(arguments)
    with board:
        if arguments.undo:
            return undo(board.session, asked, arguments.json)
        return calibrate(board.session, asked, put, arguments.json)


def opened(arguments: argparse.Namespace) -> tuple[LinkBoard, Callable[[str], None] | None]:
    """The board, and what puts its body into a pose; None where a person does."""
    from plumb.errors import UsageError

    hand = options.hand_of(arguments.hand, arguments.board)
    if arguments.board not in SIMULATED:
        if arguments.system:
            raise UsageError("--system is for `virtual`: `plumb params tuning SYSTEM` makes another board that system")
        return options.linked_board_of(arguments), hand
    from plumb.boards.held import open_held

    system = options.system_with(arguments, "poses")
    held = open_held(arguments.board, system, arguments.seed, link=arguments.link, image=arguments.image)
    return held.board, held.put


class Person:
    """The holder of the body: a person, or the hand of a simulated board."""

    def __init__(self, asked: Questions, put: Callable[[str], None] | None) -> None:
        self._asked, self._put = asked, put

    def place(self, pose: Pose) -> None:
        if self._put is None:
            self._asked.wait(f"{pose.name}: {pose.text}, and let go")
        else:
            print(f"{pose.name}: the hand of the simulated board does it: {pose.text}", file=sys.stderr)
            self._put(pose.name)

    def turn(self, text: str, end: Pose) -> None:
        from plumb.calibration.axis_calibration import TURN_S

        if self._put is None:
            self._asked.begin(f"within {TURN_S - 1:.0f} s: {text}; hold it still there")
        else:
            print(f"the turn: {text}", file=sys.stderr)
            self._put(end.name)

    def refused(self, reason: str) -> None:
        self._asked.refused(reason)


def calibrate(session: Session, asked: Questions, put: Callable[[str], None] | None, as_json: bool) -> int:
    from plumb.calibration.vector_calibration import VectorCalibration, calibration_of
    from plumb.errors import ExitCode

    calibration = calibration_of(session)
    if put is None and isinstance(calibration, VectorCalibration):
        print(calibration.poses.PICTURE, file=sys.stderr)
    found = calibration.run(Person(asked, put))
    if not as_json:
        print("\n".join(report(found)))
    written = bool(found.words) and asked.agree("write", "write this to the board?", False)
    saved = False
    if written:
        saved = write(session, found.table, found.words, asked)
    if as_json:
        print(json.dumps(as_object(found, written, saved)))
    elif not found.words:
        print("nothing to change")
    return ExitCode.GOOD if written or not found.words else ExitCode.BAD_VERDICT


def write(session: Session, table: dict[str, int], words: dict[str, int], asked: Questions) -> bool:
    """Commit, remember what was replaced, and save if that is wanted; returns whether it was saved."""
    from plumb.api.parameters import Parameters

    params, after = Parameters(session), {**table, **words}
    params.write_words(after)
    params.kept.add(NAME, table, after)
    return keep(session, asked)


def keep(session: Session, asked: Questions) -> bool:
    save = asked.agree("save", "and save it in the board's flash, for every start?", True)
    if save:
        session.execute_idle("SAVE")
    print(f"in use{', and saved' if save else ' until the board is reset'}", file=sys.stderr)
    return save


def undo(session: Session, asked: Questions, as_json: bool) -> int:
    """Put back what the last calibration of this board replaced; other parameters stay as they are."""
    from plumb.errors import ExitCode, UsageError
    from plumb.link import parameter_history, parameter_table
    from plumb.spec.parameter_file import by_name

    unique_id = session.require_match().unique_id
    changes = parameter_history.read(unique_id)
    places = [index for index, change in enumerate(changes) if change.did == NAME]
    if not places:
        raise UsageError(f"no calibration of board {unique_id} was made from here: there is nothing to undo")
    table = by_name(parameter_table.read_table(session))
    words = changes[places[-1]].before
    if not as_json:
        print("\n".join(in_units(table, words)))
    if not asked.agree("write", "put these back?", True):
        return ExitCode.BAD_VERDICT
    after = {**table, **words}
    parameter_table.commit(session, after)
    is_last = places[-1] == len(changes) - 1 and changes[-1].crc32 == parameter_history.crc_of(table)
    left = changes[: places[-1]] + changes[places[-1] + 1 :]
    left += [] if is_last or after == table else [parameter_history.change_of(f"{NAME} --undo", table, after)]
    parameter_history.write(unique_id, left)
    saved = keep(session, asked)
    if as_json:
        print(json.dumps({"undone": words, "saved": saved, "left": len(places) - 1}))
    return ExitCode.GOOD


def report(found: Calibrated) -> list[str]:
    """The errors before and after, and the parameters that change."""
    rows = [
        ("gravity at rest, off 1 g (rms)", 1e3 * found.before.norm_g, 1e3 * found.after.norm_g, "mg"),
        ("tilt of the poses (rms)", found.before.pose_deg, found.after.pose_deg, "deg"),
        ("rate at rest", found.before.bias_dps, found.after.bias_dps, "deg/s"),
        ("gyro over the turn back, off the accelerometer", found.before.turn_deg, found.after.turn_deg, "deg"),
    ]
    width = max(len(row[0]) for row in rows)
    lines = [f"{'':<{width}}  {'before':>9}  {'after':>9}"]
    lines += [f"{name:<{width}}  {before:>9.2f}  {after:>9.2f}  {unit}" for name, before, after, unit in rows]
    return lines + list(found.remarks) + in_units(found.table, found.words)


def in_units(table: dict[str, int], words: dict[str, int]) -> list[str]:
    """The parameters that change, in engineering units."""
    from plumb.spec.tuning import NUMBER
    from plumb.tuning import quantities

    names = quantities.quantities_of(table)
    before, after = quantities.values_of(table), quantities.values_of({**table, **words})
    return [
        f"{names[name].alias}: {before[name]:.6g} -> {after[name]:.6g}"
        + (f" {names[name].unit}" if names[name].unit != NUMBER else "")
        for name in before
        if before[name] != after[name]
    ]


def as_object(found: Calibrated, written: bool, saved: bool) -> dict[str, object]:
    return {
        "verdict": "pass",
        "system": found.system,
        "before": asdict(found.before),
        "after": asdict(found.after),
        "remarks": list(found.remarks),
        "changed": {name: {"from": found.table[name], "to": word} for name, word in found.words.items()},
        "written": written,
        "saved": saved,
    }

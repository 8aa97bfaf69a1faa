"""First steps with a board: find it, flash it, choose its system, look at its sensors, calibrate, watch it.

    plumb setup
    plumb setup --board serial:/dev/ttyUSB0
    plumb setup --board virtual --answers FILE        without anybody: for trials, and for CI
    plumb setup --board serial:board --hand hand.txt --answers FILE    over the port of `plumb virtual-board --hand`

Each step says what it found, and asks before it changes anything; Enter takes the answer in brackets. It ends with a
green light: the board runs on its own sensors, at its period, without a fault or a loss, and its tilt is that of the
accelerometer. The board is never armed. It can be begun anew at any time.

`native` is the main loop in this process, faster than `virtual` and without Unicorn.

FILE is TOML with an answer for each question that comes up: board, system, sensors (texts); flash, tuning, calibrate,
write, save, remember (true or false). Exit code 0 with a green light, 1 without.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.boards.link import LinkBoard
    from plumb.cli.questions import Questions
    from plumb.link.monitor import Snapshot
    from plumb.link.session import Session

SIMULATED = ("virtual", "native")
BOOT0_WAIT_S = 60.0
"""Time for a jumper and a button."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_board(parser, linked=True, required=False, about="this board, instead of being asked")
    options.add_system_with(parser, "poses", "system, instead of being asked")
    options.add_link(parser)
    options.add_image(parser, "flash image of `virtual`, or to write to the board")
    options.add_seed(parser, "the errors of the sensors of `virtual`")
    options.add_hand(parser)
    parser.add_argument("--answers", type=Path, metavar="FILE", help="answer the questions from this TOML file")
    options.add_json(parser, " at the end")


def main(arguments: argparse.Namespace) -> int:
    from plumb.calibration import rest_check
    from plumb.cli.questions import questions
    from plumb.errors import ExitCode

    asked = questions(arguments.answers)
    progress("1. the board")
    board = arguments.board or choose_board(asked)
    options.check_of_virtual(arguments, board)
    hand = options.hand_of(arguments.hand, board)
    if board not in SIMULATED:
        progress("2. the image")
        flash(board, arguments, asked)
    progress("3. the system")
    opened, put = open_board(board, arguments, asked)
    put = put or hand
    with opened:
        session = opened.session
        progress("4. the sensors")
        look_at_sensors(session)
        calibrated = asked.agree("calibrate", "5. calibrate the sensors now?", True)
        if calibrated:
            calibrate(session, asked, put)
        progress("6. the first look")
        level(asked, put, session)
        snapshot, troubles = rest_check.examine(session)
        shown = summary(snapshot)
    for text in troubles:
        progress(f"   not well: {text}")
    if not troubles and board not in SIMULATED:
        remember(board, asked)
    if arguments.json:
        print(json.dumps({"green": not troubles, "board": board, "calibrated": calibrated, "troubles": troubles}))
    else:
        print(f"{'GREEN' if not troubles else 'NOT GREEN'}: {shown}")
    return ExitCode.GOOD if not troubles else ExitCode.BAD_VERDICT


def progress(text: str) -> None:
    """Progress, on stderr: stdout has the result."""
    print(text, file=sys.stderr, flush=True)


def choose_board(asked: Questions) -> str:
    """One of the boards that may be here, the virtual one, or a name."""
    from plumb.link.discovery import candidates

    found = candidates()
    for one in found:
        progress(f"   {one.name}  {one.about}")
    names = [one.name for one in found]
    default = names[0] if names else "virtual"
    return asked.choose("board", "   which board?", [*names, "virtual", "another name ..."], default)


def flash(board: str, arguments: argparse.Namespace, asked: Questions) -> None:
    """Offer to flash the image: it is the default when no board answers, or one that does not match or has not the
    system."""
    from plumb.cli import flash as flash_command
    from plumb.flash.image import find_image
    from plumb.link.endpoint_names import SerialName, parse_board

    name = parse_board(board)
    state, well = answer_of(board, arguments.system)
    progress(f"   {state}")
    if not isinstance(name, SerialName) or "://" in name.port:
        return
    if not asked.agree("flash", f"   write {find_image(arguments.image)} to it?", not well):
        return
    values = {"port": name.port, "probe": None, "baud": 115200, "image": arguments.image, "wait": BOOT0_WAIT_S}
    flash_command.main(argparse.Namespace(**values, json=False))
    asked.wait("   set BOOT0 to 0 if you had set it, and press RESET")


def answer_of(board: str, system: str | None = None) -> tuple[str, bool]:
    """The board that answers there, in a sentence, and whether it matches this plumb and has the system, if one is
    named."""
    from plumb.link.discovery import Candidate, ask

    answer = ask(Candidate(board, ""))
    if answer.identity is None:
        return answer.trouble, False
    about = f"plumb board {answer.identity.unique_id}, {answer.identity.image_text}"
    if answer.identity.mismatch:
        return f"{about}; {answer.identity.mismatch}", False
    if system is not None and system not in answer.identity.systems:
        return f"{about}; it has no {system}", False
    return about, True


def open_board(
    board: str, arguments: argparse.Namespace, asked: Questions
) -> tuple[LinkBoard, Callable[[str], None] | None]:
    """The board as the chosen system, and what puts its body into a pose; None where a person does."""
    from plumb import systems
    from plumb.boards import open_link_board
    from plumb.link import parameter_table
    from plumb.spec import declarations, images
    from plumb.spec.parameter_file import by_name

    able = known = systems.with_part("poses")
    if board in SIMULATED:
        from plumb.boards.held import open_held

        name = arguments.system or asked.choose("system", "   which system?", able, systems.default_for("poses"))
        held = open_held(board, name, arguments.seed, link=arguments.link, image=arguments.image)
        return held.board, held.put
    opened = open_link_board(board)
    try:
        identity = opened.session.require_match()
        able = tuple(name for name in able if name in identity.systems)
        if not able:
            from plumb.errors import UsageError

            image = images.to_flash(known[0], identity.systems).name
            raise UsageError(
                f"the board's image has only {', '.join(identity.systems)}, which plumb cannot calibrate: "
                f"plumb flash --image {image}"
            )
        present = declarations.name_of(by_name(parameter_table.read_table(opened.session))["system"])
        default = present if present in able else able[0]
        name = arguments.system or asked.choose("system", "   which system?", able, default)
        if asked.agree("tuning", f"   set the shipped parameters of {name}?", name != present):
            set_tuning(opened.session, name, *sensors_of(name, asked))
    except BaseException:
        opened.close()
        raise
    return opened, None


def sensors_of(name: str, asked: Questions) -> tuple[str, Mapping[str, int]]:
    """The tuning for the board's own sensors, of several sets the one that is wired; and what else it is told of
    them."""
    from plumb import systems
    from plumb.systems.contracts import PINS, SensorSets

    parts = systems.load(name, PINS)
    if not isinstance(parts, SensorSets):
        return parts.TUNING, {}
    sets = (*parts.SENSOR_SETS, *parts.SENSORS_ALIKE)
    chosen = asked.choose("sensors", "   which sensors are wired?", sets, parts.TUNING)
    return parts.SENSORS_ALIKE.get(chosen, (chosen, {}))


def set_tuning(session: Session, name: str, tuning: str, told: Mapping[str, int]) -> None:
    """As `plumb params tuning NAME TUNING`, with the parameters `told`."""
    from plumb.api.parameters import Parameters
    from plumb.systems import shipped_tunings

    params = Parameters(session)
    before = params.words
    after = {**before, **shipped_tunings.words_of(name, tuning), **told}
    params.write_words(after, before)
    params.kept.add(f"tuning {name} {tuning}", before, after, tuning)


def look_at_sensors(session: Session) -> None:
    """Say which sensors are there. Raises LinkError when one is not."""
    from plumb.calibration.axis_calibration import sensors_missing
    from plumb.errors import LinkError
    from plumb.link import monitor

    monitor.begin_live(session)
    for _ in monitor.watch(session, 1.0):
        pass
    lost = sensors_missing(session)
    session.end()
    if lost:
        raise LinkError(f"{'; '.join(lost)}: wire it as in docs/wiring, then begin again")
    progress("   gyro and accelerometer answer")


def calibrate(session: Session, asked: Questions, put: Callable[[str], None] | None) -> None:
    from contextlib import redirect_stdout

    from plumb.cli import calibrate as calibrate_command

    with redirect_stdout(sys.stderr):
        calibrate_command.calibrate(session, asked, put, False)


def level(asked: Questions, put: Callable[[str], None] | None, session: Session) -> None:
    """Into the first pose, for the look at the end."""
    from plumb import systems
    from plumb.systems.contracts import POSES

    pose = systems.load(session.system, POSES).POSES[0]
    if put is None:
        asked.wait(f"   {pose.name}: {pose.text}, and let go")
    else:
        put(pose.name)


def summary(last: Snapshot) -> str:
    """The last state in a line."""
    values = [
        ("tilt", last["tilt_deg"], "deg"),
        ("rate", last["rate_dps"], "deg/s"),
        ("bias", last["bias_dps"], "deg/s"),
    ]
    words = [f"{name} {value:+z.2f} {unit}" for name, value, unit in values if value is not None]
    rate = last["steps_per_s"]
    return ", ".join([*words, f"{rate:.1f} steps/s" if rate is not None else "no steps"])


def remember(board: str, asked: Questions) -> None:
    from plumb.files import settings
    from plumb.link.endpoint_names import SerialName, parse_board

    if not asked.agree("remember", f"   take {board} whenever --board is left out?", True):
        return
    name = parse_board(board)
    port = name.port if isinstance(name, SerialName) and "://" not in name.port else None
    settings.change({"board": board, **({"port": port} if port else {})})

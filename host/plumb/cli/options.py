"""Options that several commands share: each is declared here once, with its help text.

An `add_...` function adds one option to a parser or to a group of options; `board_of` and `linked_board_of` open the
board that the options name. Only the imports that argparse needs are at the top, so that --help is fast.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli.whole_numbers import whole_number

if TYPE_CHECKING:
    from plumb.boards.contract import StepBoard
    from plumb.boards.link import LinkBoard
    from plumb.readers.imu_files.given import Given

Options = argparse._ActionsContainer
"""A parser, or a group of options of one."""

DEFAULT_SEED = 1000
VIRTUAL = "virtual"
IMAGE_SOURCES = ": a file, or the NAME of one (default: all), from the checkout's builds, else the package"
ANY_BOARD = "native, qemu, virtual, serial:PORT, can:BUS or auto"
LINKED_BOARD = "virtual, serial:PORT, can:BUS or auto"
BUS = "serial:PORT[@BAUD], tcp:HOST:PORT, udp:PORT, can:INTERFACE:CHANNEL[@KBIT] or file:PATH"


def add_board(parser: Options, *, linked: bool = False, required: bool = True, about: str = "") -> None:
    """--board. linked: only boards with a link; about: what the command does with the board. `settle_board` completes
    it."""
    boards = LINKED_BOARD if linked else ANY_BOARD
    if required:
        parser.add_argument("--board", metavar="B", help=f"{boards} (default: the setting `board`)")
        parser.set_defaults(board_required=True)
    else:
        parser.add_argument("--board", metavar="B", help=f"{about}: {boards}" if about else boards)


def add_boards(parser: Options, *, default: str, also: str = "") -> None:
    """--board, repeatable. also: a kind of board that only this command accepts."""
    boards = f"{ANY_BOARD}; {also}" if also else ANY_BOARD
    parser.add_argument("--board", action="append", metavar="B", help=f"{boards}; repeatable (default: {default})")


READ_FILES = ("file", "log", "params", "answers")
"""Destinations of arguments that name files to read."""


def check_typed(arguments: argparse.Namespace) -> None:
    """Raises UsageError for a system, a file or an image that is not there: what was typed wrong is named before a
    board that was left out, or does not answer."""
    from plumb.files.input_files import check_regular
    from plumb.spec import declarations

    system = getattr(arguments, "system", None)
    for name in [system] if isinstance(system, str) else system or []:
        declarations.system(name)
    for destination in READ_FILES:
        given = getattr(arguments, destination, None)
        for path in given if isinstance(given, list) else [given]:
            if isinstance(path, Path) and not path.exists():
                check_regular(path, "give a file that exists")
    image = getattr(arguments, "image", None)
    boards = getattr(arguments, "board", None)
    used = VIRTUAL in boards if isinstance(boards, list) else boards in (None, VIRTUAL)
    if used and getattr(arguments, "port", None) != "native" and isinstance(image, Path) and not image.exists():
        from plumb.flash.image import find_image

        find_image(image)


def settle_board(arguments: argparse.Namespace) -> None:
    """Put the setting `board` where a required --board was left out, and a board's own name in the place of `auto`;
    stderr then says which. Raises UsageError, LinkError; UsageError also for an option that the board does not take."""
    asked = getattr(arguments, "board", None)
    if asked is None and getattr(arguments, "board_required", False):
        import sys

        from plumb.errors import UsageError
        from plumb.files import settings

        asked = settings.read().get("board")
        if asked is None:
            raise UsageError(
                "name the board with --board: virtual, serial:PORT, ..., or auto for the only one that is here; "
                "`plumb settings board=auto` remembers it"
            )
        if asked != "auto":
            print(f"board {asked}, from the settings", file=sys.stderr)
    if isinstance(asked, list):
        arguments.board = [_named(one) for one in asked]
        check_of_virtual(arguments, *arguments.board)
    elif asked is not None:
        arguments.board = _named(asked)
        check_of_virtual(arguments, arguments.board)


def _named(board: str) -> str:
    import sys

    from plumb.link.discovery import AUTO, resolved

    name = resolved(board)
    if board == AUTO:
        print(f"board {name}, the only one here", file=sys.stderr)
    return name


def port_of(arguments: argparse.Namespace) -> str:
    """The serial port of --port, or of the setting `port`; the only adapter that is here for `auto`, and stderr then
    says which. Raises UsageError without any, LinkError for `auto` unless there is exactly one."""
    import sys

    from plumb.errors import UsageError
    from plumb.files import settings
    from plumb.link.discovery import AUTO, only_port

    asked = arguments.port or settings.read().get("port")
    if asked is None:
        raise UsageError(
            "name the adapter with --port: a serial port, or auto for the only one; `plumb ports` lists them"
        )
    port = only_port() if asked == AUTO else str(asked)
    if port != arguments.port:
        print(f"port {port}, {'the only one here' if asked == AUTO else 'from the settings'}", file=sys.stderr)
    return port


class _OfVirtual(argparse.Action):
    """Stores the value, and which option was given: `check_of_virtual` refuses it for other boards."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, option: str | None = None
    ) -> None:
        setattr(namespace, self.dest, values)
        namespace.of_virtual = option


def check_of_virtual(arguments: argparse.Namespace, *boards: str) -> None:
    """Raises UsageError where an option of `virtual` was given and `virtual` is not among the boards."""
    from plumb.errors import UsageError

    option = getattr(arguments, "of_virtual", None)
    if option and VIRTUAL not in boards:
        raise UsageError(f"{option} is for board {VIRTUAL}: name {VIRTUAL} among the boards, or leave {option} out")


def add_link(parser: Options) -> None:
    """--link; see `check_of_virtual`."""
    parser.add_argument(
        "--link", action=_OfVirtual, choices=("serial", "can"), default="serial", help=f"link to `{VIRTUAL}`"
    )


def add_image(parser: Options, what: str = "flash image") -> None:
    """--image: a file, or the name of an image in the package."""
    parser.add_argument("--image", type=Path, help=what + IMAGE_SOURCES)


def add_gdb(parser: Options, about: str, *, of_virtual: bool = False) -> None:
    """--gdb. about: when gdb may come; of_virtual: see `check_of_virtual`."""
    parser.add_argument(
        "--gdb",
        action=_OfVirtual if of_virtual else "store",
        type=whole_number,
        metavar="PORT",
        help=f"serve gdb at this port of this machine, 0: a free one; {about}",
    )


GDB_FIRST = "the chip waits for it before its first instruction"
GDB_ANY_TIME = "it may come and go at any time"


def add_link_and_image(parser: Options) -> None:
    """--link and --image, for --board virtual."""
    add_link(parser)
    about = f"flash image of `{VIRTUAL}`{IMAGE_SOURCES}"
    parser.add_argument("--image", type=Path, action=_OfVirtual, help=about)


def add_system_argument(parser: Options) -> None:
    """SYSTEM, first on the command line."""
    from plumb.spec import declarations

    parser.add_argument("system", metavar="SYSTEM", help=", ".join(declarations.names()))


def add_system(parser: Options, about: str) -> None:
    """--system."""
    parser.add_argument("--system", metavar="SYSTEM", help=about)


def add_system_with(parser: Options, part: str, about: str) -> None:
    """--system, limited to systems whose folder has that module; `system_with` returns the chosen one."""
    from plumb import systems

    parser.add_argument(
        "--system", choices=systems.with_part(part), help=f"{about} (default: the system that declares it)"
    )


def system_with(arguments: argparse.Namespace, part: str) -> str:
    """The system of --system, or the default for that part; raises UsageError if there is none. Call `print_default`
    once the run has begun."""
    from plumb import systems

    return systems.default_for(part) if arguments.system is None else str(arguments.system)


def print_default(arguments: argparse.Namespace, name: str, part: str) -> None:
    """Print to stderr which system is the default, if --system is absent, and the alternatives."""
    import sys

    from plumb import systems

    if arguments.system is None:
        others = [other for other in systems.with_part(part) if other != name]
        also = f"; --system takes {', '.join(others)}, too" if others else ""
        print(f"system {name}, the default of {part}{also}", file=sys.stderr)


def add_systems(parser: Options, about: str) -> None:
    """--system, repeatable."""
    parser.add_argument("--system", action="append", metavar="SYSTEM", help=f"{about}; repeatable")


def add_scenario(parser: Options) -> None:
    """--scenario."""
    parser.add_argument(
        "--scenario", metavar="NAME", help="scenario (default: the system's own); a wrong name lists all"
    )


def add_tuning(parser: Options) -> None:
    """--tuning."""
    parser.add_argument("--tuning", metavar="NAME", help="tuning (default: the system's own); a wrong name lists all")


def add_conditions(parser: Options, text: str) -> None:
    """--condition. text: of what."""
    parser.add_argument("--condition", action="append", default=[], metavar="NAME=NUMBER", help=f"{text}; repeatable")


def add_faults(parser: Options, text: str) -> None:
    """--fault. text: which."""
    metavar = "KIND[:WHAT]@START[-STOP]"
    parser.add_argument("--fault", action="append", default=[], metavar=metavar, help=text)


def add_open_loop(parser: Options) -> None:
    """--open-loop."""
    parser.add_argument("--open-loop", action="store_true", help="prescribed motion: the actuators move nothing")


def add_plant(parser: Options) -> None:
    """--system, --scenario and --seed of the plant on the pins of a board simulated in this process."""
    add_system(parser, "system whose plant is on the pins of `virtual` (default: the board's)")
    add_scenario(parser)
    add_seed(parser, "the plant")


def add_seed(parser: Options, of: str = "every random number") -> None:
    """--seed."""
    parser.add_argument(
        "--seed", type=whole_number, default=DEFAULT_SEED, help=f"seed of {of} (default {DEFAULT_SEED})"
    )


def add_seconds(parser: Options, about: str, default: float | None = None) -> None:
    """--seconds."""
    parser.add_argument("--seconds", type=float, metavar="N", default=default, help=about)


def add_duration(parser: Options) -> None:
    """--seconds, of a command that runs until Ctrl-C; see `check_duration`."""
    add_seconds(parser, "how long (default: until Ctrl-C)")


def add_out(parser: Options, default: Path | None = None) -> None:
    """--out, the folder of a run's report."""
    shown = "" if default is None else f" (default: {default})"
    about = f"write DIR/report.html, DIR/summary.json and DIR/steps.csv{shown}"
    parser.add_argument("--out", type=Path, metavar="DIR", default=default, help=about)


def add_force(parser: Options) -> None:
    """--force, of a command that writes files of the user's."""
    parser.add_argument("--force", action="store_true", help="overwrite a file that exists")


def add_given(parser: Options) -> None:
    """--units, --columns and --frame; `given_of` parses them."""
    parser.add_argument("--units", metavar="U", help='units of a table: "gyr=rad/s,acc=m/s2,time=us", or some of them')
    parser.add_argument(
        "--columns", metavar="C", help='columns of a table by name: "time=t,gyr=wx wy wz,acc=ax ay az", or some of them'
    )
    parser.add_argument(
        "--frame",
        choices=("flu", "frd", "ios", "android"),
        help="axes as written: flu front left up (default), frd front right down; phones: x right, y to the top, z out "
        "of the screen, android with +1 g on z face up, ios with -1 g",
    )


def given_of(arguments: argparse.Namespace) -> Given:
    """What add_given's options say; raises UsageError."""
    from plumb.readers.imu_files.given import parse

    return parse(arguments.units, arguments.columns, arguments.frame)


def add_log_run(parser: Options) -> None:
    """--log-run and --params, of a command that reads a log; `params_of` reads the latter."""
    parser.add_argument(
        "--log-run",
        type=whole_number,
        metavar="N",
        help="of a log: its run number N (default: the one of which most is known)",
    )
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="of a log without parameters: a file of `plumb params dump`"
    )


def params_of(arguments: argparse.Namespace) -> dict[str, int] | None:
    """The parameters of --params by name; None without it. Raises UsageError for a file that cannot be used."""
    from plumb.spec import parameter_file

    return None if arguments.params is None else parameter_file.read(arguments.params).values


def add_hand(parser: Options) -> None:
    """--hand, for a served board that another process holds."""
    about = "file or pipe of `plumb virtual-board --hand FILE`: its hand makes the poses"
    parser.add_argument("--hand", metavar="FILE", help=about)


def hand_of(hand: str | None, board: str | None) -> Callable[[str], None] | None:
    """Function that puts the body of a served board into a pose, from --hand; None without it."""
    if hand is None:
        return None
    from functools import partial

    from plumb.boards.hand_orders import STDIN, send_order
    from plumb.errors import UsageError

    if hand == STDIN or board in ("virtual", "native"):
        raise UsageError("--hand names the file of a board that `plumb virtual-board --hand FILE` serves")
    return partial(send_order, hand)


def add_json(parser: Options, when: str = "") -> None:
    """--json."""
    parser.add_argument("--json", action="store_true", help=f"print JSON{when}")


def check_duration(seconds: float | None) -> None:
    """Raises UsageError unless --seconds is absent or greater than 0."""
    from plumb.errors import UsageError

    if seconds is not None and not seconds > 0:
        raise UsageError(f"--seconds {seconds:g}: give a number greater than 0")


def board_of(arguments: argparse.Namespace, board: str | None = None) -> StepBoard:
    """The board that --board, --link and --image name; board: instead of --board. Raises UsageError, LinkError."""
    from plumb.boards import open_board

    return open_board(board or arguments.board, link=arguments.link, image=arguments.image)


def linked_board_of(arguments: argparse.Namespace) -> LinkBoard:
    """The same for commands that need a link; raises UsageError for a board without one, LinkError."""
    from plumb.boards import open_link_board

    return open_link_board(arguments.board, link=arguments.link, image=arguments.image)


def link_of(arguments: argparse.Namespace) -> str | None:
    """The link to name in a summary: --link for `virtual`, None for a board with only one link."""
    return str(arguments.link) if arguments.board == "virtual" else None

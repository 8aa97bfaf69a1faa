"""Read, change and save the parameters of a board, in engineering units.

    plumb params list --board serial:/dev/ttyUSB0
    plumb params list kalman --board serial:/dev/ttyUSB0
    plumb params get pid.kp period_us --board serial:/dev/ttyUSB0
    plumb params set pid.kp=0.05 kalman.q_bias=2e-4 kalman.r=0.05 --board serial:/dev/ttyUSB0
    plumb params set period_us=10000 --board serial:/dev/ttyUSB0
    plumb params set --raw pid.kp_q22=75497472 --board serial:/dev/ttyUSB0
    plumb params tuning balancer --board serial:/dev/ttyUSB0 --save
    plumb params save --board serial:/dev/ttyUSB0
    plumb params load --board serial:/dev/ttyUSB0
    plumb params reset --save --board serial:/dev/ttyUSB0
    plumb params dump board.toml --board serial:/dev/ttyUSB0
    plumb params load board.toml --board serial:/dev/ttyUSB0
    plumb params edit --board serial:/dev/ttyUSB0
    plumb params diff --board serial:/dev/ttyUSB0
    plumb params diff defaults board.toml --board serial:/dev/ttyUSB0
    plumb params undo --board serial:/dev/ttyUSB0
    plumb params profile save windy --board serial:/dev/ttyUSB0
    plumb params profile use windy --board serial:/dev/ttyUSB0

Values are in the unit that `list` shows: deg, deg/s, g, s, us. The board holds integers, each within 0.1 %
of its value; a value that its integer would miss by more is refused. `period_us` is the period of a step for the timer
and for the filter. A name may be short (`pid.kp`) or whole (`pid.kp_per_deg`). `list` marks with a star what differs
from the shipped tuning that the parameters came from, and shows the tuning's value. --raw shows and takes the integers
of the board's table by their own names; then nothing keeps integers that belong together in step.

A change is staged, then committed by the CRC-32 of the whole resulting table; the board accepts it as a whole or
refuses it with the reason. A change ends a run in progress; a run in real time goes on if only gains of controllers
change (pid.kp, pid.ki, pid.kd). No change disarms a board: an armed one takes gains alone, from the link that armed
it, each to at most twice and at least half of what it was at arming, and refuses the rest with the nearest value.
`tuning` configures the board as a system with one of its shipped tunings, their period and the settings of the
actuator. `set`, `tuning`, `load` and `reset` change the parameters in use until the board is reset; `save`, or --save
with any of them, writes the parameters in use to the board's flash, which it loads at every start. `load` takes a
file of `dump`, or without a file the contents of the flash; `reset` restores the factory values. `virtual` is a new
board every time: a change shows whether a board accepts it.

`edit` opens the parameters in units in $VISUAL or $EDITOR and commits what you change; `load` takes such a file, too.
`diff` compares two of: board, tuning (the shipped one that the board's parameters came from), defaults (factory
values), profile:NAME, or a file; exit code 1 says that they differ. `undo` takes back the last change that was made
from this computer, in this session or an earlier one; again, the one before. A profile is a name for a whole table, of
this board alone: boards are identified by their unique id. Changes and profiles lie in the platform's places (Linux:
~/.local/state/plumb, ~/.config/plumb).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from plumb.cli import options

VERBS = ("list", "get", "set", "tuning", "save", "load", "reset", "dump", "edit", "diff", "undo", "profile")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    each = argparse.ArgumentParser(add_help=False)
    options.add_board(each, linked=True)
    options.add_link_and_image(each)
    options.add_json(each)
    integers = argparse.ArgumentParser(add_help=False)
    integers.add_argument("--raw", action="store_true", help="the integers of the board's table, by their own names")
    keep = argparse.ArgumentParser(add_help=False)
    keep.add_argument("--save", action="store_true", help="also save the parameters in the board's flash")
    verbs = parser.add_subparsers(dest="action", required=True, metavar="|".join(VERBS))
    show = verbs.add_parser(
        "list", parents=[each, integers], help="every parameter: value, unit, meaning, and what differs from the tuning"
    )
    show.add_argument("filter", nargs="?", metavar="FILTER", help="text in the name or meaning, or a pattern: pid.*")
    one = verbs.add_parser("get", parents=[each, integers], help="the named parameters, with their limits and integers")
    one.add_argument("names", nargs="+", metavar="NAME")
    change = verbs.add_parser("set", parents=[each, integers, keep], help="change some")
    change.add_argument(
        "assignments", nargs="+", metavar="NAME=VALUE", help="parameter and its value in the unit that `list` shows"
    )
    tune = verbs.add_parser(
        "tuning", parents=[each, keep], help="configure the board as a system, with a shipped tuning"
    )
    options.add_system_argument(tune)
    tune.add_argument("tuning", nargs="?", metavar="TUNING", help="tuning (default: as in `plumb run`)")
    verbs.add_parser("save", parents=[each], help="save the parameters in use in the board's flash")
    give = verbs.add_parser(
        "load", parents=[each, keep], help="commit a file, or without FILE the parameters saved in flash"
    )
    give.add_argument("file", type=Path, nargs="?", metavar="FILE")
    verbs.add_parser("reset", parents=[each, keep], help="factory values")
    write = verbs.add_parser("dump", parents=[each], help="write the whole table and its CRC-32 to a TOML file")
    write.add_argument("written", type=Path, metavar="FILE")
    verbs.add_parser("edit", parents=[each, keep], help="edit the parameters in units, as text, in $VISUAL or $EDITOR")
    compare = verbs.add_parser("diff", parents=[each, integers], help="what differs; exit code 1 if anything does")
    side = "board, tuning, defaults, profile:NAME, or a file"
    compare.add_argument("one", nargs="?", default="tuning", metavar="FROM", help=f"{side} (default: tuning)")
    compare.add_argument("other", nargs="?", default="board", metavar="TO", help="the same (default: board)")
    back = verbs.add_parser("undo", parents=[each, keep], help="take back the last change made from this computer")
    back.add_argument("--list", action="store_true", help="show the changes, the latest last, and change nothing")
    profile = verbs.add_parser(
        "profile", parents=[each, keep], help="named tables of this board: list, save, use, delete"
    )
    profile.add_argument("what", choices=("list", "save", "use", "delete"), help="what to do")
    profile.add_argument("name", nargs="?", metavar="NAME", help="name of the profile")
    profile.add_argument("--force", action="store_true", help="`save` replaces a profile of that name")


def main(arguments: argparse.Namespace) -> int:
    from plumb.cli import params_edit, params_session, params_sources

    if arguments.action == "edit":
        return params_edit.edit(arguments)
    if arguments.action == "profile" and (arguments.what == "list") != (arguments.name is None):
        from plumb.errors import UsageError

        if arguments.name is not None:
            raise UsageError("`profile list` takes no name: it shows every profile of the board")
        raise UsageError(f"say which profile: plumb params profile {arguments.what} NAME")
    warnings: list[str] = []
    # A mistake in the values is reported before a board is opened.
    integers = params_sources.integers_asked(arguments, warnings)
    with options.linked_board_of(arguments) as board:
        return params_session.with_board(arguments, board.session, integers, warnings)

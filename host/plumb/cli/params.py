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

Values are in the unit that `list` shows beside each: deg, deg/s, g, s, us. The board holds integers, each within 0.1 %
of its value; a value that its integer would miss by more is refused. `period_us` is the period of a step for the timer
and for the filter. A name may be short (`pid.kp`) or whole (`pid.kp_per_deg`). `list` marks with a star what differs
from the shipped tuning that the parameters came from, and shows the tuning's value. --raw shows and takes the integers
of the board's table by their own names; then nothing keeps integers that belong together in step.

A change is staged, then committed by the CRC-32 of the whole resulting table; the board accepts it as a whole or
refuses it with the reason. A change ends a run in progress; a run in real time goes on if only gains of controllers
change (pid.kp, pid.ki, pid.kd). No change disarms a board: an armed one takes gains alone, from the link that armed it,
each to at most twice and at least half of what it was, and refuses the rest with the nearest value. `tuning` configures
the board as a system with one of its shipped tunings, their period and the settings of the actuator. `set`, `tuning`,
`load` and `reset` change the parameters in use until the board is reset; `save`, or --save with any of them, writes the
parameters in use to the board's flash, which it loads at every start. `load` takes a file of `dump`, or without a file
the contents of the flash; `reset` restores the factory values. `virtual` is a new board every time: a change shows
whether a board accepts it.

`edit` opens the parameters in units in $VISUAL or $EDITOR and commits what you change; `load` takes such a file, too.
`diff` compares two of: board, tuning (the shipped one that the board's parameters came from), defaults (factory
values), profile:NAME, or a file; exit code 1 says that they differ. `undo` takes back the last change that was made
from this computer, in this session or an earlier one; again, the one before. A profile is a name for a whole table, of
this board alone: boards are told apart by their unique id. Changes and profiles lie in the platform's places (Linux:
~/.local/state/plumb, ~/.config/plumb).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.link.identity import Identity
    from plumb.link.session import Session

VERBS = ("list", "get", "set", "tuning", "save", "load", "reset", "dump", "edit", "diff", "undo", "profile")
CHANGES = ("set", "tuning", "load", "reset", "save", "edit", "undo")


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
    write.add_argument("file", type=Path, metavar="FILE")
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
    from plumb.cli import params_edit

    if arguments.action == "edit":
        return params_edit.edit(arguments)
    if arguments.action == "profile" and (arguments.what == "list") != (arguments.name is None):
        from plumb.errors import UsageError

        if arguments.name is not None:
            raise UsageError("`profile list` takes no name: it shows every profile of the board")
        raise UsageError(f"say which profile: plumb params profile {arguments.what} NAME")
    warnings: list[str] = []
    integers = integers_asked(arguments, warnings)  # a mistake in them is told before a board is opened
    with options.linked_board_of(arguments) as board:
        return with_board(arguments, board.session, integers, warnings)


def with_board(arguments: argparse.Namespace, session: Session, integers: dict[str, int], warnings: list[str]) -> int:
    """Everything that is done while the board is open. integers, warnings: of `integers_asked`."""
    from plumb.cli import params_kept
    from plumb.link import parameter_table

    raw = getattr(arguments, "raw", False)
    identity = session.identity
    if identity is not None and identity.mismatch:
        warnings.append(identity.mismatch)
        if not raw and arguments.action in ("list", "get"):
            warnings.append("its parameters are shown as integers, as with --raw: their units may not be this plumb's")
            raw = True
    warn(warnings)
    words = parameter_table.read_table(session)
    if arguments.action in ("diff", "profile") or (arguments.action == "undo" and arguments.list):
        session.require_match()
        done = params_kept.show(arguments, session, words)
        if done is not None:
            return done
        integers = params_kept.profile_words(arguments, session, warnings)
    if arguments.action in CHANGES or arguments.action == "profile":
        session.require_match()
        return change(arguments, session, words, integers, warnings)
    if arguments.action == "dump":
        return dump(arguments, words)
    print(show_integers(arguments, words) if raw else show_quantities(arguments, words, session))
    return 0


def integers_asked(arguments: argparse.Namespace, warnings: list[str]) -> dict[str, int]:
    """The integers that the command line or a file asks for; raises UsageError. Adds the warnings about a file."""
    from plumb.cli import params_text
    from plumb.spec import parameter_file
    from plumb.systems import shipped_tunings
    from plumb.tuning import quantities_file

    if arguments.action == "set" and arguments.raw:
        return parameter_file.assignments(arguments.assignments)
    if arguments.action == "tuning":
        return shipped_tunings.words_of(arguments.system, arguments.tuning)
    if arguments.action == "get" and arguments.raw:
        for name in arguments.names:
            parameter_file.row_named(name)
    if arguments.action == "list" and arguments.raw:
        params_text.raw_rows(arguments.filter)
    if arguments.action != "load" or arguments.file is None or quantities_file.is_in_units(arguments.file):
        return {}
    return integers_of_file(arguments.file, warnings)


def integers_of_file(path: Path, warnings: list[str]) -> dict[str, int]:
    """The integers of a file of `dump`; raises UsageError. Adds the warnings about it."""
    from plumb.spec import parameter_file

    said = parameter_file.read(path)
    warnings += [f"{path}: {old} is named {new} now; the value is used" for old, new in said.renamed.items()]
    warnings += [f"{path}: there is no parameter '{name}'; it is ignored" for name in said.unknown]
    warnings += [f"{path}: {name} is missing; the board's value stays" for name in said.missing]
    if said.edited:
        warnings.append(f"{path}: the values do not match the CRC-32 in the file: it was edited")
    return said.values


# ---- reading ----


def show_quantities(arguments: argparse.Namespace, words: list[int], session: Session) -> str:
    """The text of `list` or `get` in units."""
    from plumb.api import parameters as api
    from plumb.cli import params_kept, params_text
    from plumb.spec import parameter_file, parameters

    table = parameter_file.by_name(words)
    crc = f"0x{parameters.crc32(words):08x}"
    if arguments.action == "get":
        found = [api.description(name, table) for name in arguments.names]
        if arguments.json:
            return json.dumps({"crc32": crc, "parameters": [params_text.described(one) for one in found]})
        return "\n\n".join(params_text.in_units(one, table) for one in found)
    origin = params_kept.origin_of(session, table)
    entries = params_text.matching(arguments.filter, params_text.listed(table, origin))
    if arguments.json:
        said = {"crc32": crc, "system": origin.system, "tuning": origin.tuning, "parameters": entries}
        return json.dumps(said)
    return params_text.listing(entries, origin, table)


def show_integers(arguments: argparse.Namespace, words: list[int]) -> str:
    """The text of `list --raw` or `get --raw`."""
    from plumb.cli import params_text
    from plumb.spec import parameter_file, parameters

    values = parameter_file.by_name(words)
    if arguments.action == "get":
        rows = tuple(parameter_file.row_named(name) for name in arguments.names)
    else:
        rows = params_text.raw_rows(arguments.filter)
    entries = [params_text.describe(row, values) for row in rows if row.name in values]
    if arguments.json:
        return json.dumps({"crc32": f"0x{parameters.crc32(words):08x}", "parameters": entries})
    if arguments.action == "list":
        return params_text.raw_listing(entries)
    return "\n\n".join(map(params_text.in_full, entries))


def dump(arguments: argparse.Namespace, words: list[int]) -> int:
    from plumb.spec import parameter_file, parameters

    parameter_file.write(arguments.file, parameter_file.text_of(words))
    crc = f"0x{parameters.crc32(words):08x}"
    summary = {"file": str(arguments.file), "parameters": len(words), "crc32": crc}
    print(json.dumps(summary) if arguments.json else f"{len(words)} parameters, CRC-32 {crc}: {arguments.file}")
    return 0


# ---- writing ----


def change(
    arguments: argparse.Namespace, session: Session, words: list[int], integers: dict[str, int], warnings: list[str]
) -> int:
    """Execute the verb, or commit the values that it asks for; keep what `undo` needs, and print what changed."""
    from plumb.cli import params_kept
    from plumb.link import parameter_table
    from plumb.spec import parameter_file

    before = parameter_file.by_name(words)
    if arguments.action == "reset":
        session.execute_idle("DEFAULTS", keep_armed=True)
    elif arguments.action == "load" and arguments.file is None:
        session.execute_idle("LOAD", keep_armed=True)
    elif arguments.action != "save":
        session.pump()  # an armed board waits for its keep-alive
        wanted = wanted_table(arguments, session, before, integers)
        session.pump()
        parameter_table.commit(session, wanted, before)
    after = parameter_table.read_table(session)
    not_kept = params_kept.keep(arguments, session, before, parameter_file.by_name(after))
    warn(not_kept)
    warnings += not_kept
    if arguments.action == "save" or getattr(arguments, "save", False):
        session.execute_idle("SAVE", keep_armed=True)
    identity = session.connect()
    return report_change(arguments, words, after, identity, warnings)


def wanted_table(
    arguments: argparse.Namespace, session: Session, before: dict[str, int], integers: dict[str, int]
) -> dict[str, int]:
    """The whole table that a command asks for; raises UsageError."""
    from plumb.cli import params_kept
    from plumb.tuning import quantities, quantities_file

    if arguments.action == "undo":
        return params_kept.undone(session, before)
    if arguments.action == "set" and not arguments.raw:
        return quantities.changed(before, quantities.assignments(arguments.assignments, before))
    if arguments.action in ("load", "edit") and not integers:
        text = quantities_file.read_text(arguments.file)
        return quantities.changed(before, quantities_file.wanted(text, str(arguments.file), before))
    return {**before, **integers}


def report_change(
    arguments: argparse.Namespace, words: list[int], after_words: list[int], identity: Identity, warnings: list[str]
) -> int:
    """Print the parameters that changed, and where those in use come from."""
    from plumb.cli import params_text
    from plumb.spec import parameter_file, parameters

    before, after = parameter_file.by_name(words), parameter_file.by_name(after_words)
    crc = f"0x{parameters.crc32(after_words):08x}"
    changed = [row for row in parameters.table() if after[row.name] != before[row.name]]
    doubts = parameter_file.warnings(after) + at_next_start(identity, after, [row.name for row in changed])
    source = identity.parameter_source
    warn(doubts)
    if arguments.json:
        integers = {row.name: {"from": before[row.name], "to": after[row.name]} for row in changed}
        units = params_text.changes(before, after)
        said = {"crc32": crc, "changed": integers, "quantities": units, "source": source, "warnings": warnings + doubts}
        print(json.dumps(said))
        return 0
    raw = getattr(arguments, "raw", False)
    for line in params_text.raw_change_lines(before, after) if raw else params_text.change_lines(before, after):
        print(line)
    count = len(changed) if raw or before["system"] != after["system"] else len(params_text.changes(before, after))
    what = f"{count} changed" if changed else "nothing changed"
    print(f"in use, CRC-32 {crc}: {what}; they are {source}")
    return 0


def at_next_start(identity: Identity, values: dict[str, int], changed: list[str]) -> list[str]:
    """Warnings about parameters that take effect at the next start."""
    from plumb.link.identity import PINS

    sentences = []
    if identity["PINS"] != values["pins"]:
        chosen, asked = PINS.get(identity["PINS"], "?"), PINS.get(values["pins"], "?")
        sentences.append(
            f"the board's strap says pins: {chosen}; the parameters say {asked}: save, power off, wire the strap for "
            f"{asked}; until both agree no actuator pin is driven"
        )
    waiting = ["pins"] if "pins" in changed and not sentences else []
    waiting += ["dead_time_ns"] if "dead_time_ns" in changed else []
    if waiting:
        sentences.append(f"{' and '.join(waiting)} is read only at the start: save and reset the board")
    return sentences


def warn(sentences: list[str]) -> None:
    for sentence in sentences:
        print(f"plumb: warning: {sentence}", file=sys.stderr)

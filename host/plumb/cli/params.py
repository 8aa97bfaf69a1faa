"""Read, change and save the parameters of a board, or write them to a file.

    plumb params list --board serial:/dev/ttyUSB0
    plumb params get pid.kp_q22 period_us --board serial:/dev/ttyUSB0
    plumb params set period_us=10000 pid.slew_q22=0x100000 --board serial:/dev/ttyUSB0
    plumb params tuning balancer --board serial:/dev/ttyUSB0 --save
    plumb params save --board serial:/dev/ttyUSB0
    plumb params load --board serial:/dev/ttyUSB0
    plumb params reset --save --board serial:/dev/ttyUSB0
    plumb params dump board.toml --board serial:/dev/ttyUSB0
    plumb params load board.toml --board serial:/dev/ttyUSB0

Values are the integers of the board's table, shown with their meaning in engineering units. A change is staged, then
committed by the CRC-32 of the whole resulting table; the board accepts it as a whole or refuses it with the reason. A
change disarms the board and ends a run in progress. `tuning` configures the board as a system with one of its shipped
tunings, their period and the settings of the actuator. `set`, `tuning`, `load` and `reset` change the
parameters in use until the board is reset; `save`, or --save with any of them, writes the parameters in use to the
board's flash, which it loads at every start. `load` takes a file of `dump`, or without a file the contents of the
flash; `reset` restores the factory values. `virtual` is a new board every time: a change shows whether a board accepts
it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.link.identity import Identity
    from plumb.link.session import Session
    from plumb.spec.parameters import Parameter


def add_arguments(parser: argparse.ArgumentParser) -> None:
    each = argparse.ArgumentParser(add_help=False)
    options.add_board(each, linked=True)
    options.add_link_and_image(each)
    options.add_json(each)
    keep = argparse.ArgumentParser(add_help=False)
    keep.add_argument("--save", action="store_true", help="also save the parameters in the board's flash")
    verbs = parser.add_subparsers(dest="action", required=True, metavar="list|get|set|tuning|save|load|reset|dump")
    verbs.add_parser("list", parents=[each], help="every parameter: value, meaning, range, default")
    one = verbs.add_parser("get", parents=[each], help="the named parameters, with their descriptions")
    one.add_argument("names", nargs="+", metavar="NAME")
    change = verbs.add_parser("set", parents=[each, keep], help="change some")
    change.add_argument("assignments", nargs="+", metavar="NAME=VALUE", help="parameter and its integer value")
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


def main(arguments: argparse.Namespace) -> int:
    from plumb.link import parameter_table
    from plumb.spec import parameter_file, parameters

    rows = parameters.table()
    wanted: dict[str, int] = {}
    warnings: list[str] = []
    if arguments.action == "get":
        rows = tuple(parameter_file.row_named(name) for name in arguments.names)
    elif arguments.action == "set":
        wanted = parameter_file.assignments(arguments.assignments)
    elif arguments.action == "tuning":
        wanted = table_of(arguments.system, arguments.tuning)
    elif arguments.action == "load" and arguments.file is not None:
        said = parameter_file.read(arguments.file)
        wanted = said.values
        warnings += [
            f"{arguments.file}: {old} is named {new} now; the value is used" for old, new in said.renamed.items()
        ]
        warnings += [f"{arguments.file}: there is no parameter '{name}'; it is ignored" for name in said.unknown]
        warnings += [f"{arguments.file}: {name} is missing; the board's value stays" for name in said.missing]
        if said.edited:
            warnings.append(f"{arguments.file}: the values do not match the CRC-32 in the file: it was edited")
    with options.linked_board_of(arguments) as board:
        identity = board.session.identity
        if identity is not None and identity.mismatch:
            warnings.append(identity.mismatch)
        warn(warnings)
        words = parameter_table.read_table(board.session)
        if arguments.action in ("set", "tuning", "load", "reset", "save"):
            verb = "DEFAULTS" if arguments.action == "reset" else ""
            verb = "LOAD" if arguments.action == "load" and arguments.file is None else verb
            after = change(board.session, verb, words, wanted)
            if arguments.action == "save" or arguments.save:
                board.session.execute_idle("SAVE")
            identity = board.session.connect()
            return report_change(words, after, identity, warnings, arguments.json)
    values = parameter_file.by_name(words)
    if arguments.action == "dump":
        parameter_file.write(arguments.file, parameter_file.text_of(words))
        crc = f"0x{parameters.crc32(words):08x}"
        summary = {"file": str(arguments.file), "parameters": len(words), "crc32": crc}
        print(json.dumps(summary) if arguments.json else f"{len(words)} parameters, CRC-32 {crc}: {arguments.file}")
        return 0
    described = [describe(row, values) for row in rows if row.name in values]
    if arguments.json:
        print(json.dumps({"crc32": f"0x{parameters.crc32(words):08x}", "parameters": described}))
    else:
        print(as_table(described) if arguments.action == "list" else "\n\n".join(map(in_full, described)))
    return 0


def table_of(name: str, tuning: str | None) -> dict[str, int]:
    """Parameters by name of a shipped tuning of a system; raises UsageError for an unknown system or tuning."""
    from plumb import systems
    from plumb.errors import UsageError
    from plumb.tuning.quantise import quantise

    system = systems.load(name)
    chosen = tuning or system.DEFAULT_TUNING
    if chosen not in system.TUNINGS:
        raise UsageError(f"{name} has no tuning '{chosen}'; use one of {', '.join(system.TUNINGS)}")
    pins = {"pins": 0} if system.OUTPUTS else {}  # the pins of speed controllers, unless the system names others
    params = quantise(system.TUNINGS[chosen])
    return {**params.values, **params.link_words(), "period_us": system.PERIOD_US, **pins, **system.LINK}


def change(session: Session, verb: str, words: list[int], wanted: dict[str, int]) -> list[int]:
    """Execute a verb, or else commit the wanted values, if any; returns the table in use afterwards."""
    from plumb.link import parameter_table
    from plumb.spec import parameter_file

    session.require_match()
    if verb:
        session.execute_idle(verb)
    elif wanted:
        parameter_table.commit(session, {**parameter_file.by_name(words), **wanted})
    return parameter_table.read_table(session)


def report_change(
    words: list[int], after_words: list[int], identity: Identity, warnings: list[str], as_json: bool
) -> int:
    """Print the parameters that changed, and where those in use come from."""
    from plumb.spec import parameter_file, parameters
    from plumb.spec.units import meaning

    before, after = parameter_file.by_name(words), parameter_file.by_name(after_words)
    crc = f"0x{parameters.crc32(after_words):08x}"
    changed = [row for row in parameters.table() if after[row.name] != before[row.name]]
    doubts = parameter_file.warnings(after) + at_next_start(identity, after, [row.name for row in changed])
    source = identity.parameter_source
    warn(doubts)
    if as_json:
        rows = {row.name: {"from": before[row.name], "to": after[row.name]} for row in changed}
        print(json.dumps({"crc32": crc, "changed": rows, "source": source, "warnings": warnings + doubts}))
        return 0
    for row in changed:
        means = str(meaning(row, after))
        print(f"{row.name}: {before[row.name]} -> {after[row.name]}" + (f" ({means})" if means else ""))
    what = f"{len(changed)} changed" if changed else "nothing changed"
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


class Described(TypedDict):
    """One parameter in `params ... --json`: its declaration, its integer, and its value in engineering units."""

    name: str
    owner: str
    type: str
    unit: str
    format: str
    min: int
    max: int
    default: int
    doc: str
    value: int
    meaning: float | str | None
    meaning_unit: str
    meaning_text: str


def describe(row: Parameter, values: dict[str, int]) -> Described:
    """One parameter as printed with --json."""
    from plumb.spec.units import meaning

    means = meaning(row, values)
    return {
        "name": row.name,
        "owner": row.owner,
        "type": row.type,
        "unit": row.unit,
        "format": row.format,
        "min": row.min,
        "max": row.max,
        "default": row.default,
        "doc": row.doc,
        "value": values[row.name],
        "meaning": means.choice or means.value,
        "meaning_unit": means.unit,
        "meaning_text": str(means),
    }


def as_table(described: list[Described]) -> str:
    """One line for each parameter, with a star if it differs from the default."""
    head = ["  name", "value", "meaning", "unit, format", "range", "default"]
    lines = [head]
    for entry in described:
        star = "  " if entry["value"] == entry["default"] else "* "
        kind = ", ".join(filter(None, (entry["unit"], entry["format"])))
        bounds = f"{entry['min']} .. {entry['max']}"
        lines.append(
            [star + entry["name"], str(entry["value"]), entry["meaning_text"], kind, bounds, str(entry["default"])]
        )
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip() for line in lines)


def in_full(entry: Described) -> str:
    """One parameter with its description."""
    kind = ", ".join(filter(None, (entry["type"], entry["unit"], entry["format"])))
    means = f"  = {entry['meaning_text']}" if entry["meaning_text"] else ""
    return (
        f"{entry['name']} = {entry['value']}{means}\n"
        f"  {entry['doc']}\n"
        f"  {kind}; {entry['min']} .. {entry['max']}, default {entry['default']}"
    )

"""The parameters of a board: read them, change them, keep them in a file.

    plumb params list --board serial:/dev/ttyUSB0
    plumb params get pid.kp_q22 period_us --board serial:/dev/ttyUSB0
    plumb params set period_us=10000 pid.slew_q22=0x100000 --board serial:/dev/ttyUSB0
    plumb params dump quad.toml --board serial:/dev/ttyUSB0
    plumb params load quad.toml --board serial:/dev/ttyUSB0

Values are the integers of the board's table; what they mean in engineering units is shown beside them. A change is
staged, then committed by the CRC-32 of the whole resulting table, and acknowledged, or refused as a whole with the
reason; it disarms the board and ends a run that is on. Values live until the board is reset: this image stores none in
flash, so keep them in a file with `dump` and give them back with `load`. `virtual` is a new board every time: there, a
change tells whether the board would take it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plumb.parameters import Parameter
    from plumb.session import Session


def add_arguments(parser: argparse.ArgumentParser) -> None:
    each = argparse.ArgumentParser(add_help=False)
    each.add_argument("--board", required=True, metavar="B", help="virtual or serial:PORT[@BAUD]")
    each.add_argument("--image", type=Path, help="flash image for `virtual` (default: the checkout's build)")
    each.add_argument("--json", action="store_true", help="print JSON")
    verbs = parser.add_subparsers(dest="action", required=True, metavar="list|get|set|dump|load")
    verbs.add_parser("list", parents=[each], help="every parameter: value, meaning, range, default")
    one = verbs.add_parser("get", parents=[each], help="some parameters, with what they are for")
    one.add_argument("names", nargs="+", metavar="NAME")
    change = verbs.add_parser("set", parents=[each], help="change some; they live until the board is reset")
    change.add_argument("assignments", nargs="+", metavar="NAME=VALUE", help="integers of the table")
    keep = verbs.add_parser("dump", parents=[each], help="write the whole table and its CRC-32 to a TOML file")
    keep.add_argument("file", type=Path, metavar="FILE")
    give = verbs.add_parser("load", parents=[each], help="commit a file; values live until the board is reset")
    give.add_argument("file", type=Path, metavar="FILE")


def main(arguments: argparse.Namespace) -> int:
    from plumb import parameters, tablefile
    from plumb.boards.link import open_link_board

    rows = parameters.table()
    wanted: dict[str, int] = {}
    warnings: list[str] = []
    if arguments.action == "get":
        rows = tuple(tablefile.row_named(name) for name in arguments.names)
    elif arguments.action == "set":
        wanted = tablefile.assignments(arguments.assignments)
    elif arguments.action == "load":
        said = tablefile.read(arguments.file)
        wanted = said.values
        warnings += [f"{arguments.file}: there is no parameter '{name}'; it is left out" for name in said.unknown]
        warnings += [f"{arguments.file}: {name} is missing; the board's value stays" for name in said.missing]
        if said.edited:
            warnings.append(f"{arguments.file}: the values are not those its CRC-32 was taken of: it was edited since")
    with open_link_board(arguments.board, image=arguments.image) as board:
        identity = board.session.identity
        if identity is not None and identity.mismatch:
            warnings.append(identity.mismatch)
        warn(warnings)
        words = tablefile.read_table(board.session)
        if wanted:
            return change_values(board.session, words, wanted, warnings, arguments.json)
    values = tablefile.by_name(words)
    if arguments.action == "dump":
        tablefile.write(arguments.file, tablefile.text_of(words))
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


def change_values(
    session: Session, words: list[int], wanted: dict[str, int], warnings: list[str], as_json: bool
) -> int:
    """Commit the board's table with what is wanted in it, and say what changed."""
    from plumb import parameters, tablefile
    from plumb.meaning import meaning

    session.require_match()
    before = tablefile.by_name(words)
    after = {**before, **wanted}
    crc = f"0x{tablefile.commit(session, after):08x}"
    doubts = tablefile.doubts(after)
    warn(doubts)
    changed = [row for row in parameters.table() if after[row.name] != before[row.name]]
    if as_json:
        rows = {row.name: {"from": before[row.name], "to": after[row.name]} for row in changed}
        print(json.dumps({"crc32": crc, "changed": rows, "warnings": warnings + doubts}))
        return 0
    for row in changed:
        means = str(meaning(row, after))
        print(f"{row.name}: {before[row.name]} -> {after[row.name]}" + (f" ({means})" if means else ""))
    what = f"{len(changed)} changed" if changed else "nothing changed"
    print(f"committed, CRC-32 {crc}: {what}; the values live until the board is reset")
    return 0


def warn(sentences: list[str]) -> None:
    for sentence in sentences:
        print(f"plumb: warning: {sentence}", file=sys.stderr)


def describe(row: Parameter, values: dict[str, int]) -> dict[str, Any]:
    """Everything about one parameter, as it goes into JSON."""
    from dataclasses import asdict

    from plumb.meaning import meaning

    means = meaning(row, values)
    return {
        **asdict(row),
        "value": values[row.name],
        "meaning": means.choice or means.value,
        "meaning_unit": means.unit,
        "meaning_text": str(means),
    }


def as_table(described: list[dict[str, Any]]) -> str:
    """One line a parameter; a star where it is not the default."""
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


def in_full(entry: dict[str, Any]) -> str:
    """One parameter with what it is for."""
    kind = ", ".join(filter(None, (entry["type"], entry["unit"], entry["format"])))
    means = f"  = {entry['meaning_text']}" if entry["meaning_text"] else ""
    return (
        f"{entry['name']} = {entry['value']}{means}\n"
        f"  {entry['doc']}\n"
        f"  {kind}; {entry['min']} .. {entry['max']}, default {entry['default']}"
    )

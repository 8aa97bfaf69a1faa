"""`plumb params` while a board is open: read its parameters, show them, change them, and say what changed."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from plumb.cli import params_sources

if TYPE_CHECKING:
    from plumb.api.parameters import Parameters
    from plumb.link.identity import Identity
    from plumb.link.session import Session

CHANGES = ("set", "tuning", "load", "reset", "save", "edit", "undo")


def with_board(arguments: argparse.Namespace, session: Session, integers: dict[str, int], warnings: list[str]) -> int:
    """Everything that is done while the board is open. integers, warnings: of `params_sources.integers_asked`."""
    from plumb.api.parameters import Parameters
    from plumb.cli import params_kept

    params = Parameters(session)
    raw = getattr(arguments, "raw", False)
    identity = session.identity
    if identity is not None and identity.mismatch:
        warnings.append(identity.mismatch)
        if not raw and arguments.action in ("list", "get"):
            warnings.append("its parameters are shown as integers, as with --raw: their units may not be this plumb's")
            raw = True
    params_sources.warn(warnings)
    words = params.read_words()
    if arguments.action in ("diff", "profile") or (arguments.action == "undo" and arguments.list):
        session.require_match()
        done = params_kept.show(arguments, params.kept, words)
        if done is not None:
            return done
        integers = params_kept.profile_words(arguments, params.kept, warnings)
    if arguments.action in CHANGES or arguments.action == "profile":
        session.require_match()
        session.pump()  # an armed board waits for its keep-alive
        after = change(arguments, params, words, integers, warnings)
        return report_change(arguments, words, after, session.connect(), warnings)
    if arguments.action == "dump":
        return dump(arguments, words)
    print(show_integers(arguments, words) if raw else show_quantities(arguments, words, params))
    return 0


# ---- reading ----


def show_quantities(arguments: argparse.Namespace, words: list[int], params: Parameters) -> str:
    """The text of `list` or `get` in units."""
    from plumb.api import parameters as api
    from plumb.cli import params_text
    from plumb.spec import parameter_file, parameters

    table = parameter_file.by_name(words)
    crc = f"0x{parameters.crc32(words):08x}"
    if arguments.action == "get":
        found = [api.description(name, table) for name in arguments.names]
        if arguments.json:
            return json.dumps({"crc32": crc, "parameters": [params_text.described(one) for one in found]})
        return "\n\n".join(params_text.in_units(one, table) for one in found)
    origin = params.kept.origin(table)
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
    entries = [params_text.raw_entry(row, values) for row in rows if row.name in values]
    if arguments.json:
        return json.dumps(
            {"crc32": f"0x{parameters.crc32(words):08x}", "parameters": [entry.to_json() for entry in entries]}
        )
    if arguments.action == "list":
        return params_text.raw_listing(entries)
    return "\n\n".join(map(params_text.in_full, entries))


def dump(arguments: argparse.Namespace, words: list[int]) -> int:
    from plumb.spec import parameter_file, parameters

    parameter_file.write(arguments.written, parameter_file.text_of(words))
    crc = f"0x{parameters.crc32(words):08x}"
    summary = {"file": str(arguments.written), "parameters": len(words), "crc32": crc}
    print(json.dumps(summary) if arguments.json else f"{len(words)} parameters, CRC-32 {crc}: {arguments.written}")
    return 0


# ---- writing ----


def change(
    arguments: argparse.Namespace, params: Parameters, words: list[int], integers: dict[str, int], warnings: list[str]
) -> list[int]:
    """Execute the verb, or commit the values that it asks for, and keep what `undo` needs; the table after it."""
    from plumb.cli import params_kept
    from plumb.spec import parameter_file

    before = parameter_file.by_name(words)
    if arguments.action == "reset":
        params.reset()
    elif arguments.action == "load" and arguments.file is None:
        params.load()
    elif arguments.action != "save":
        params.write_words(wanted_table(arguments, params, before, integers), before)
    after = params.read_words()
    not_kept = params_kept.keep(arguments, params.kept, before, parameter_file.by_name(after))
    params_sources.warn(not_kept)
    warnings += not_kept
    if arguments.action == "save" or getattr(arguments, "save", False):
        params.save()
    return after


def wanted_table(
    arguments: argparse.Namespace, params: Parameters, before: dict[str, int], integers: dict[str, int]
) -> dict[str, int]:
    """The whole table that a command asks for; raises UsageError."""
    from plumb.tuning import quantities, quantities_file

    if arguments.action == "undo":
        return params.kept.before_last(before)
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
    params_sources.warn(doubts)
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

"""Records that `plumb params` keeps here: changes for `undo`, and profiles. And `diff`, which compares with them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from plumb.api.kept_parameters import KeptParameters
from plumb.cli import params_sources, params_text
from plumb.errors import UsageError
from plumb.link.parameter_history import Change
from plumb.spec import parameter_file, parameters
from plumb.tuning import quantities, quantities_file

# ---- undo ----


def keep(
    arguments: argparse.Namespace, kept: KeptParameters, before: Mapping[str, int], after: Mapping[str, int]
) -> list[str]:
    """Remember a change, or forget one that was undone; gives the warning if that is impossible: the change is made."""
    try:
        if arguments.action == "undo":
            kept.forget_last(before)
        else:
            kept.add(_did(arguments), before, after, _tuning(arguments))
    except UsageError as error:
        return [f"`plumb params undo` will not know this change: {error}"]
    return []


def _did(arguments: argparse.Namespace) -> str:
    """The command as it is shown by `undo --list`."""
    said = [arguments.action]
    if arguments.action == "set":
        said += ["--raw"] * arguments.raw + arguments.assignments
    elif arguments.action == "tuning":
        said += [arguments.system, arguments.tuning]
    elif arguments.action == "load":
        said += [arguments.file]
    elif arguments.action == "profile":
        said += [arguments.what, arguments.name]
    return " ".join(str(word) for word in said if word is not None)


def _tuning(arguments: argparse.Namespace) -> str | None:
    """The shipped tuning that the parameters come from after a change; "" if that is not known, None if as before."""
    from plumb import systems

    if arguments.action == "tuning":
        return str(arguments.tuning or systems.load(arguments.system).DEFAULT_TUNING)
    if arguments.action in ("set", "edit") or (arguments.action == "load" and arguments.file is not None):
        return None
    return ""


def _list_changes(arguments: argparse.Namespace, changes: Sequence[Change]) -> int:
    if arguments.json:
        shown = [{"time": one.time, "did": one.did, "before": one.before, "after": one.after} for one in changes]
        print(json.dumps({"changes": shown}))
        return 0
    for one in changes:
        count = len(one.after)
        what = one.did if one.did.isprintable() else ascii(one.did)
        print(f"{one.time}  {what}  ({count} integer{'s' * (count != 1)})")
    if not changes:
        print("no change of this board's parameters was made from here")
    return 0


# ---- profiles ----


def show(arguments: argparse.Namespace, kept: KeptParameters, words: list[int]) -> int | None:
    """Do what changes nothing on the board, and return the exit code; None for `profile use`."""
    if arguments.action == "diff":
        return _diff(arguments, kept, parameter_file.by_name(words))
    if arguments.action == "undo":
        return _list_changes(arguments, kept.changes)
    if arguments.what == "use":
        return None
    if arguments.what == "list":
        return _list_profiles(arguments, kept, parameter_file.by_name(words))
    if arguments.what == "save":
        path = kept.save_profile(arguments.name, words, replace=arguments.force)
    else:
        path = kept.delete_profile(arguments.name)
    said = {"profile": arguments.name, "file": str(path)}
    print(json.dumps(said) if arguments.json else f"{arguments.what}d {arguments.name}: {path}")
    return 0


def _list_profiles(arguments: argparse.Namespace, kept: KeptParameters, table: dict[str, int]) -> int:
    names = kept.profiles
    in_use = [name for name in names if kept.holds(name, table)]
    if arguments.json:
        print(json.dumps({"board": kept.unique_id, "profiles": names, "in_use": in_use}))
        return 0
    for name in names:
        print(f"{'*' if name in in_use else ' '} {name}")
    if not names:
        print("this board has no profiles: `plumb params profile save NAME` makes one")
    return 0


def profile_words(arguments: argparse.Namespace, kept: KeptParameters, warnings: list[str]) -> dict[str, int]:
    """The integers of the profile that is to be used; raises UsageError."""
    known = len(warnings)
    values = params_sources.integers_of_file(kept.profile(arguments.name), warnings)
    params_sources.warn(warnings[known:])
    return values


# ---- diff ----


def _diff(arguments: argparse.Namespace, kept: KeptParameters, board: dict[str, int]) -> int:
    """Print what differs between two tables; 1 if anything does."""
    (one, before), (other, after) = (_side(name, kept, board) for name in (arguments.one, arguments.other))
    lines = params_text.raw_change_lines(before, after) if arguments.raw else params_text.change_lines(before, after)
    if arguments.json:
        moved = {
            row.name: {"from": before[row.name], "to": after[row.name]}
            for row in parameters.table()
            if before[row.name] != after[row.name]
        }
        units = params_text.changes(before, after)
        print(json.dumps({"from": one, "to": other, "changed": moved, "quantities": units}))
    else:
        print("\n".join([f"from {one} to {other}: {_count(len(lines))}", *lines]))
    return 1 if lines else 0


def _count(differences: int) -> str:
    return {0: "nothing differs", 1: "1 differs"}.get(differences, f"{differences} differ")


def _side(name: str, kept: KeptParameters, board: dict[str, int]) -> tuple[str, dict[str, int]]:
    """Name of a side of a comparison, and its whole table; raises UsageError."""
    if name == "board":
        return "the board", board
    if name == "defaults":
        return "the factory values", {row.name: row.default for row in parameters.table()}
    if name == "tuning":
        origin = kept.origin(board)
        return f"the tuning '{origin.tuning}' of {origin.system}", dict(origin.table)
    kind, _, profile = name.partition(":")
    if kind == "profile" and profile:
        return f"the profile '{profile}'", {**board, **parameter_file.read(kept.profile(profile)).values}
    path = Path(name)
    if quantities_file.is_in_units(path):
        wanted = quantities_file.wanted(quantities_file.read_text(path), name, board)
        return name, quantities.changed(board, wanted)
    return name, {**board, **parameter_file.read(path).values}

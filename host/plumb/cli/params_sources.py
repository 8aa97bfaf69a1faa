"""Values that `plumb params` is asked for before a board is open: from the command line, a file, a shipped tuning."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


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


def warn(sentences: list[str]) -> None:
    for sentence in sentences:
        print(f"plumb: warning: {sentence}", file=sys.stderr)

"""`plumb params edit`: the parameters in units as a text, in the user's editor, and back to the board.

The board is not held open meanwhile: it is read again afterwards, and only what was edited changes.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from plumb.cli import options
from plumb.errors import UsageError

FALLBACKS = ("sensible-editor", "nano", "vi", "notepad")
"""Editors that are tried when neither $VISUAL nor $EDITOR names one."""


def edit(arguments: argparse.Namespace) -> int:
    """Edit and commit; raises UsageError. A text that is refused stays where it is, and the message names it."""
    from plumb.api.parameters import Parameters
    from plumb.cli import params_session
    from plumb.tuning import quantities_file

    command = editor()
    with options.linked_board_of(arguments) as board:
        board.session.require_match()
        table = Parameters(board.session).words
    title = "Parameters, each with its unit. Save and close to commit what you change; empty the file to leave it."
    before = quantities_file.text_of(table, title)
    folder = Path(tempfile.mkdtemp(prefix="plumb-params-"))
    arguments.file = folder / "params.toml"
    arguments.file.write_text(before, encoding="utf-8")
    failed = run(command, arguments.file)
    after = quantities_file.read_text(arguments.file)
    if after == before or not after.strip():
        shutil.rmtree(folder, ignore_errors=True)
        if failed:
            raise UsageError(f"{failed}: nothing was changed; set $EDITOR to your editor")
        print("nothing was edited: the board's parameters are as they were")
        return 0
    if failed:
        raise UsageError(
            f"{failed}: nothing was changed; your text is in {arguments.file}, `plumb params load` takes it"
        )
    try:
        quantities_file.wanted(after, str(arguments.file), table)
        with options.linked_board_of(arguments) as board:
            code = params_session.with_board(arguments, board.session, {}, [])
    except BaseException:
        note = f"your text is in {arguments.file}: correct it, then `plumb params load {arguments.file}`"
        print(f"plumb: {note}", file=sys.stderr)
        raise
    shutil.rmtree(folder, ignore_errors=True)
    return code


def editor() -> list[str]:
    """The command of the user's editor; raises UsageError if there is none."""
    for name in ("VISUAL", "EDITOR"):
        said = os.environ.get(name, "").strip()
        if not said:
            continue
        try:
            command = shlex.split(said)
        except ValueError as error:
            raise UsageError(f"${name} is no command ({error}): {said:.80}") from None
        if shutil.which(command[0]) is None:
            raise UsageError(f"${name} names {command[0]:.80}, which is not there: set it to your editor")
        return command
    found = next((name for name in FALLBACKS if shutil.which(name)), None)
    if found is None:
        raise UsageError("no editor is here: set $EDITOR to yours")
    return [found]


def run(command: list[str], path: Path) -> str:
    """Run the editor on a file and wait for it; "" or what went wrong."""
    try:
        code = subprocess.run([*command, str(path)], check=False).returncode
    except OSError as error:
        return f"{command[0]} cannot be run ({error.strerror})"
    return f"{command[0]} ended with code {code}" if code else ""

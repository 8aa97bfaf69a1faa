"""Profiles: whole parameter tables of a board under names, in the platform's place for settings.

A profile is a file as `plumb params dump` writes it, in a folder of the board's unique id: a vehicle has its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import places
from plumb.files.whole_files import write_whole
from plumb.link.parameter_history import NOT_FILES
from plumb.spec import parameter_file

NAME = re.compile(r"[0-9A-Za-z_][0-9A-Za-z_.-]{0,63}")
ADVICE = "make its folder writable, or move it with XDG_CONFIG_HOME"


def folder_of(unique_id: str) -> Path:
    """Folder of the profiles of a board."""
    return places.config_folder() / "profiles" / NOT_FILES.sub("_", unique_id)


def names(unique_id: str) -> list[str]:
    """The profiles of a board."""
    return sorted(path.stem for path in folder_of(unique_id).glob("*.toml"))


def path_of(unique_id: str, name: str) -> Path:
    """The file of a profile, which need not exist; raises UsageError for a name that cannot be one."""
    if not NAME.fullmatch(name):
        raise UsageError(f"'{name:.80}' is no name of a profile: letters, digits, _ - and ., at most 64")
    return folder_of(unique_id) / f"{name}.toml"


def existing(unique_id: str, name: str) -> Path:
    """The file of a profile of the board; raises UsageError with those there are."""
    path = path_of(unique_id, name)
    if not path.is_file():
        there = ", ".join(names(unique_id))
        others = f"it has {there}" if there else "it has none: `plumb params profile save NAME` makes one"
        raise UsageError(f"this board has no profile '{name}'; {others}")
    return path


def save(unique_id: str, name: str, words: Sequence[int], *, replace: bool) -> Path:
    """Write a whole table as a profile; returns its file. Raises UsageError if it exists and is not to be replaced."""
    path = path_of(unique_id, name)
    if path.exists() and not replace:
        raise UsageError(f"this board has a profile '{name}' already: choose another name, or replace it with --force")
    write_whole({path: parameter_file.text_of(words)}, ADVICE)
    return path


def delete(unique_id: str, name: str) -> Path:
    """Remove a profile; returns the file it had. Raises UsageError."""
    path = existing(unique_id, name)
    try:
        path.unlink()
    except OSError as error:
        raise UsageError(f"cannot delete {path}: {error.strerror}; {ADVICE}") from None
    return path

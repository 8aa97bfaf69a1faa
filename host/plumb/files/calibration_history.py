"""The parameters that a calibration replaced, by board: a file in the platform's place for state, so that they can be
put back in a later session."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import places
from plumb.files.input_files import read_text
from plumb.files.whole_files import write_whole

KEPT = 20
"""Calibrations that are remembered for a board."""
MOST_BYTES = 1 << 20


def history_file(board: str) -> Path:
    """board: its unique number."""
    return places.state_folder() / "calibrations" / f"{board}.json"


def replaced(board: str) -> list[dict[str, int]]:
    """What each calibration of this board replaced, the latest last. Raises UsageError for a damaged file."""
    path = history_file(board)
    if not path.exists():
        return []
    remedy = f"delete {path}, and set the parameters by hand"
    try:
        said = json.loads(read_text(path, MOST_BYTES, remedy))
    except ValueError:
        said = None
    entries: list[dict[str, int]] = []
    for entry in said if isinstance(said, list) else [None]:
        if not isinstance(entry, dict) or not all(type(word) is int for word in entry.values()):
            raise UsageError(f"{path} is damaged: {remedy}")
        entries.append(entry)
    return entries


def remember(board: str, words: Mapping[str, int]) -> None:
    """Remember what a calibration replaces, before it is written."""
    _write(board, [*replaced(board), dict(words)][-KEPT:])


def forget_last(board: str) -> None:
    _write(board, replaced(board)[:-1])


def _write(board: str, entries: list[dict[str, int]]) -> None:
    text = json.dumps(entries, indent=1) + "\n"
    write_whole({history_file(board): text}, "make its folder writable, or move it with XDG_STATE_HOME")

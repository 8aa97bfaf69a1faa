"""Changes of `plumb params` on a board, kept over sessions so that they can be undone.

One file for each board, by its unique id, in the platform's place for state: a line of JSON for each change, the latest
last.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import places
from plumb.files.input_files import read_text
from plumb.files.whole_files import write_whole
from plumb.spec import parameters

MOST_CHANGES = 100
"""Kept for each board; older ones are dropped."""
MOST_BYTES = 1 << 20
ADVICE = "make its folder writable, or move it with XDG_STATE_HOME"
NOT_FILES = re.compile(r"[^0-9A-Za-z_-]")


@dataclass(frozen=True)
class Change:
    """One change of a board's parameters.

    time: UTC, ISO 8601. did: the command without its --board. before, after: the integers that it changed, by name.
    crc32: of the whole table after it. tuning: the shipped tuning that the parameters come from since then; "" if that
    is not known, None if the change left it as it was.
    """

    time: str
    did: str
    before: dict[str, int]
    after: dict[str, int]
    crc32: int
    tuning: str | None = None


def change_of(did: str, before: Mapping[str, int], after: Mapping[str, int], tuning: str | None = None) -> Change:
    """A change that was made now. before, after: whole tables by name."""
    moved = [name for name in before if before[name] != after[name]]
    return Change(
        datetime.now(UTC).isoformat(timespec="seconds"),
        did,
        {name: before[name] for name in moved},
        {name: after[name] for name in moved},
        crc_of(after),
        tuning,
    )


def crc_of(table: Mapping[str, int]) -> int:
    """CRC-32 of a whole table by name."""
    return parameters.crc32([table[row.name] for row in parameters.table()])


def file_of(unique_id: str) -> Path:
    """Path of the changes of a board."""
    return places.state_folder() / "parameters" / f"{NOT_FILES.sub('_', unique_id)}.jsonl"


def read(unique_id: str) -> list[Change]:
    """The changes of a board, the latest last. Lines that describe no change are skipped. Raises UsageError for a file
    that cannot be read."""
    path = file_of(unique_id)
    if not path.exists():
        return []
    lines = read_text(path, MOST_BYTES, "delete it: what it remembers cannot be undone any more").splitlines()
    return [change for change in map(_parsed, lines) if change is not None]


def add(unique_id: str, change: Change) -> None:
    """Append a change. Raises UsageError when it cannot be kept."""
    write(unique_id, [*read(unique_id), change])


def write(unique_id: str, changes: list[Change]) -> None:
    """Replace the changes of a board. Raises UsageError when they cannot be kept."""
    lines = [json.dumps(asdict(change)) + "\n" for change in changes[-MOST_CHANGES:]]
    while sum(map(len, lines)) > MOST_BYTES:
        del lines[0]
    write_whole({file_of(unique_id): "".join(lines)}, ADVICE)


def last_undoable(changes: list[Change], table: Mapping[str, int]) -> int:
    """Index of the latest change that left this table. Raises UsageError if none did."""
    for index in range(len(changes) - 1, -1, -1):
        if changes[index].crc32 == crc_of(table):
            return index
    if not changes:
        raise UsageError("nothing to undo: no change of this board's parameters was made from here")
    raise UsageError(
        f"nothing to undo: the parameters in use (CRC-32 0x{crc_of(table):08x}) are not what a change from here left; "
        "the board was reset or changed elsewhere. `plumb params undo --list` shows the changes"
    )


def tuning_of(changes: list[Change]) -> str | None:
    """The shipped tuning that the parameters come from, as the changes say; None if they do not."""
    return next((change.tuning for change in reversed(changes) if change.tuning is not None), None) or None  # not ""


def _parsed(line: str) -> Change | None:
    """A line of the file; None for one that is damaged or of another version."""
    try:
        said = json.loads(line)
        change = Change(**said)
    except (ValueError, TypeError, RecursionError):
        return None
    names = {row.name for row in parameters.table()}
    tables = (change.before, change.after)
    whole = all(isinstance(one, dict) and names.issuperset(one) for one in tables) and all(
        type(value) is int for one in tables for value in one.values()
    )
    texts = isinstance(change.time, str) and isinstance(change.did, str) and isinstance(change.tuning, str | None)
    return change if whole and texts and type(change.crc32) is int else None

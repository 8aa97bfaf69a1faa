"""The manifest of the golden vectors: which vectors a full check must run, and the SHA-256 of each file.

manifest.json lies in the folder of the recipe; `plumb golden make` writes both vectors and manifest:

    {"format": "plumb golden manifest 1", "vectors": [{"name", "system", "steps", "on_link", "sha256"}, ...]}

A vector that is missing, listed twice, or replaced by a copy of another is refused before anything runs.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plumb.errors import UsageError
from plumb.proof.golden_file import read_bounded
from plumb.proof.golden_json import integer, json_object
from plumb.proof.golden_recipe import MAX_STEPS, Entry, is_name

FORMAT = "plumb golden manifest 1"
MANIFEST = "manifest.json"
MAX_BYTES = 1 << 20
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Row:
    """One vector that a full check runs. sha256: of its file, in lower-case hexadecimal digits."""

    name: str
    system: str
    steps: int
    on_link: bool
    sha256: str

    def describes(self, entry: Entry) -> bool:
        return (self.name, self.system, self.steps, self.on_link) == (
            entry.name, entry.system, entry.steps, entry.on_link,
        )  # fmt: skip


def write(folder: Path, rows: Sequence[Row]) -> None:
    text = ",\n".join("  " + json.dumps(asdict(row)) for row in rows)
    unfinished = folder / (MANIFEST + ".part")
    unfinished.write_text(f'{{"format": "{FORMAT}", "vectors": [\n{text}\n]}}\n')
    unfinished.replace(folder / MANIFEST)


def read(folder: Path) -> list[Row]:
    """The rows in order; raises UsageError when there is no manifest or it is damaged."""
    path = folder / MANIFEST
    data = read_bounded(path, MAX_BYTES)
    try:
        whole = json_object(data)
        if whole.get("format") != FORMAT or set(whole) != {"format", "vectors"}:
            raise ValueError(f"its format is not '{FORMAT}'")
        if not isinstance(whole["vectors"], list):
            raise ValueError("vectors is no list")
        rows = [_row(table) for table in whole["vectors"]]
        if len({row.name for row in rows}) != len(rows):
            raise ValueError("a name appears twice")
        if len({row.sha256 for row in rows}) != len(rows):
            raise ValueError("two names have the same file")
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise UsageError(f"{path} is damaged ({reason}); make it again with: plumb golden make") from None
    return rows


def _row(table: Any) -> Row:
    if not isinstance(table, dict) or set(table) != set(Row.__dataclass_fields__):
        raise ValueError("a vector must have exactly name, system, steps, on_link and sha256")
    if not is_name(table["name"]) or not is_name(table["system"]):
        raise ValueError("a vector has no valid name or system")
    if not isinstance(table["on_link"], bool):
        raise ValueError("on_link is neither true nor false")
    if not isinstance(table["sha256"], str) or not _SHA256.fullmatch(table["sha256"]):
        raise ValueError("a sha256 is not 64 lower-case hexadecimal digits")
    steps = integer(table["steps"], 1, MAX_STEPS, "steps")
    return Row(table["name"], table["system"], steps, table["on_link"], table["sha256"])


def require(folder: Path, entries: Sequence[Entry], systems: Sequence[str] | None = None) -> dict[str, Row]:
    """The rows of the entries by name; raises UsageError unless manifest and recipe list the same vectors.

    systems: only these are compared, as the entries were chosen.
    """
    rows = [row for row in read(folder) if not systems or row.system in systems]
    named = {row.name: row for row in rows}
    for entry in entries:
        row = named.get(entry.name)
        if row is None or not row.describes(entry):
            raise UsageError(
                f"{folder / MANIFEST} does not list {entry.name} as the recipe does; make it again with: "
                "plumb golden make"
            )
    missing = sorted(set(named) - {entry.name for entry in entries})
    if missing:
        raise UsageError(
            f"the recipe in {folder} lacks {', '.join(missing)}, which a full check must run; put it back, or make the "
            "vectors again with: plumb golden make"
        )
    return named

"""Writes report.html and summary.json of `plumb faults`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from plumb.errors import counted
from plumb.proof import run_identity
from plumb.proof.faults.runner import Row
from plumb.proof.faults.text import milliseconds
from plumb.proof.report import Statement, Table, page, write_whole

HEAD = (
    "group",
    "fault",
    "what happens",
    "link",
    "safe (ms)",
    "limit (ms)",
    "noticed (ms)",
    "limit (ms)",
    "reported",
    "",
)


def write_report(folder: Path, rows: Sequence[Row], verdict: str, image: Path, command: str) -> list[Path]:
    """Write both files into `folder`, which is created if needed; their paths. image: the flash image that ran.

    Raises UsageError when they cannot be written."""
    entry = run_identity.identity({"board": "virtual", "image": run_identity.image_of(image)}, None, command)
    failed = sum(row.verdict != "pass" for row in rows)
    faults = counted(len(rows), "fault")
    reached = f"{len(rows) - failed} of {faults}: every output safe within its limit, and the fault reported"
    systems = list(dict.fromkeys(row.scene for row in rows))
    tables = [_table(name, [row for row in rows if row.scene == name]) for name in systems]
    html = page(
        f"Injected faults, {', '.join(systems)}",
        verdict,
        "Each fault was injected into the virtual board while it was armed and drove its outputs.",
        [*tables, *run_identity.tables(entry, {})],
        [Statement("reaction", reached, not failed)],
    )
    summary = {"verdict": verdict, "faults": [row.to_json() for row in rows], "identity": entry}
    texts = {"report.html": html, "summary.json": json.dumps(summary, indent=2) + "\n"}
    write_whole(folder, texts)
    return [folder / name for name in texts]


def _table(system: str, rows: Sequence[Row]) -> Table:
    cells = [
        [
            row.group,
            row.name,
            row.what,
            row.link,
            milliseconds(row.safe_ms),
            f"{row.limit_ms:g}",
            "-" if row.detected_ms is None else milliseconds(row.detected_ms),
            f"{row.detected_limit_ms:g}",
            row.reported,
            row.verdict if not row.why else f"{row.verdict}: {row.why}",
        ]
        for row in rows
    ]
    note = "Safe: from the injection until every output stays at its safe value; 0: the fault changed no step."
    bad = frozenset(index for index, row in enumerate(rows) if row.verdict != "pass")
    return Table(system, HEAD, cells, note, bad_rows=bad)

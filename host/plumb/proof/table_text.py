"""Tables of a page as text for a terminal, columns aligned."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.proof.report import Table


def text(tables: Sequence[Table]) -> str:
    """The tables below each other, each with its title and its note."""
    return "\n\n".join(_text(table) for table in tables)


def _text(table: Table) -> str:
    lines = [list(line) for line in (table.head, *table.rows) if any(line)]
    widths = [max((len(line[at]) for line in lines), default=0) for at in range(len(table.head))]
    body = ("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines)
    note = [table.note] if table.note else []
    return "\n".join([table.title, *(f"  {line}" for line in body), *note])

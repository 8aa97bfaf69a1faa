"""Which parameter keeps a board from being armed, as far as this session knows its table."""

from __future__ import annotations

from typing import Protocol

from plumb.link.identity import BLOCKED, UNSAFE_BLOCK, Identity, bits_text
from plumb.spec import armed_values, parameters
from plumb.spec.parameter_file import by_name


class KnownTable(Protocol):
    """`table`: every word that the session last committed or read; None while unknown."""

    table: tuple[int, ...] | None


class Knows(Protocol):
    """The part of a session that is used."""

    identity: Identity | None

    @property
    def parameters(self) -> KnownTable: ...


def reason(session: Knows, index: int | None = None) -> str:
    """The sentence about the parameter. index: as the NACK of ARM has it; None: from the table, or the identity."""
    table = session.parameters.table
    values = by_name(table) if table is not None and len(table) == len(parameters.table()) else None
    if index is None and values is not None:
        found = armed_values.unsafe(values)
        return found.text if found else BLOCKED[UNSAFE_BLOCK]
    if index is None and session.identity is not None:
        index = session.identity.items.get("UNSAFE_PARAMETER", len(parameters.table()))
    if index is None or index >= len(parameters.table()):
        return BLOCKED[UNSAFE_BLOCK]
    return armed_values.reason(index, values)


def blocked_texts(session: Knows, blocked: int) -> list[str]:
    """A sentence for every bit of STATUS.blocked."""
    others = blocked & ~(1 << UNSAFE_BLOCK)
    found = bits_text(others, BLOCKED).split("; ") if others else []
    return [reason(session), *found] if blocked >> UNSAFE_BLOCK & 1 else found

"""What a reader declares about the files that it reads: the table in docs/how-to/check.md is generated from it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """written: the program or device; looks: how a person knows such a file; taken: what is read of it, and in what
    units."""

    written: str
    looks: str
    taken: str


@dataclass(frozen=True)
class Header:
    """A table whose header says its units. written: the program; line: of the header; more: besides the units."""

    written: str
    line: str
    more: str = ""

"""Words of parameter tables that were seen on a link: those that hosts staged, and those that the board sent.

No word alone says which table it is of. `table` puts them together to one that has the CRC-32 that the board announced.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from plumb.spec import parameters

WORD = 0xFFFFFFFF


class SeenWords:
    """staged: index -> word of the next table, as hosts write it; read: index -> word of the table in use, as the board
    sends it. Both since the last table that became known."""

    def __init__(self) -> None:
        self.staged: dict[int, int] = {}
        self.read: dict[int, int] = {}

    def clear(self) -> None:
        """The table is known: what was seen has served."""
        self.staged, self.read = {}, {}

    def table(self, crc32: int | None, before: Sequence[int] | None) -> tuple[int, ...] | None:
        """The table with that CRC-32: the one before it, if it is known, with the staged words or with those that were
        read. crc32 None: it is not known either, and what was read is of the table in use. None: nothing fits."""
        for seen in (self.read,) if crc32 is None else (self.staged, self.read):
            words = whole(dict(enumerate(before or ())) | seen, len(before or ()))
            if words is not None and crc32 in (None, parameters.crc32(words)):
                return words
        return None


def whole(words: Mapping[int, int], least: int = 0) -> tuple[int, ...] | None:
    """The words in the order of their indices; None unless there are exactly as many as the board has. least: so many
    it has, if this version knows of fewer parameters."""
    inside = tuple(words[index] for index in range(len(words)) if index in words)
    return inside if len(inside) == len(words) == max(len(parameters.table()), least) else None


def unsigned(word: int) -> int:
    return word & WORD

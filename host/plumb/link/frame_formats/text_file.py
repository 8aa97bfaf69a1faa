"""Lines of a text file of another tool, whatever its encoding, and whether the last one is whole."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator
from pathlib import Path
from typing import IO, cast

MOST_LINE = 1 << 16
"""Characters of one line."""
GZIP = b"\x1f\x8b"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def opened(path: Path) -> IO[bytes]:
    """The content of a file, expanded when it is compressed by gzip."""
    with path.open("rb") as file:
        compressed = file.read(len(GZIP)) == GZIP
    return cast(IO[bytes], gzip.open(path, "rb")) if compressed else path.open("rb")


def encoding_of(head: bytes) -> str:
    """By its first bytes. Frames are ASCII in every encoding but UTF-16; what else is in the file is not looked at."""
    return "utf-16" if head.startswith(_UTF16) else "utf-8-sig"


def lines_of(path: Path) -> Iterator[tuple[str, bool]]:
    """Each line without its end, and whether it has one. A compressed file that is cut gives what came before.

    Raises ValueError for a line that is too long, and what gzip raises for a damaged file.
    """
    with opened(path) as file:
        encoding = encoding_of(file.read(2))
    with opened(path) as file, io.TextIOWrapper(file, encoding, errors="replace") as text:
        while True:
            try:
                line = text.readline(MOST_LINE + 1)
            except EOFError:
                yield "", False
                return
            if not line:
                return
            if len(line) > MOST_LINE:
                raise ValueError(f"it has more than {MOST_LINE} characters")
            yield line.rstrip("\n"), line.endswith("\n")

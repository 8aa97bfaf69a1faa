"""The formats of frames that are read, and how a file's first bytes tell which it has. The suffix decides nothing."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from plumb.link.frame_formats import asc, busmaster, candump, tables, trc
from plumb.link.frame_formats.records import LineReader, Lines
from plumb.link.frame_formats.text_file import GZIP, encoding_of

HEAD_BYTES = 1 << 16
"""Of a file, as it is and expanded, by which its format is told."""
HEAD_LINES = 200


@dataclass(frozen=True)
class Format:
    """A format. name: as sentences have it; suffixes: that its files mostly have; begins: whether lines are the first
    of such a file, and reader: of its lines; magic: the first bytes of a binary format, which a library reads."""

    name: str
    suffixes: tuple[str, ...]
    begins: Callable[[list[str]], bool] | None = None
    reader: Callable[[Lines], LineReader] | None = None
    magic: bytes = b""


BLF = Format("BLF", (".blf",), magic=b"LOGG")
MF4 = Format("MF4", (".mf4",), magic=b"MDF     ")
FORMATS = (
    BLF,
    MF4,
    Format("python-can's CSV", (".csv",), tables.begins_python_can, tables.PythonCan),
    Format("SavvyCAN's GVRET CSV", (".csv",), tables.begins_gvret, tables.Gvret),
    Format("BusMaster's log", (".log",), busmaster.begins, busmaster.Reader),
    Format("ASC", (".asc",), asc.begins, asc.Reader),
    Format("TRC", (".trc",), trc.begins, trc.Reader),
    Format("candump", (".log",), candump.begins, candump.Reader),
)
SUFFIXES = tuple(dict.fromkeys(suffix for one in FORMATS for suffix in one.suffixes))
NAMES = ", ".join(one.name for one in FORMATS)


def head_of(path: Path) -> bytes:
    """The first bytes of a regular file, expanded when it is compressed by gzip; b"" when it cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        return zlib.decompressobj(31).decompress(head, HEAD_BYTES) if head.startswith(GZIP) else head
    except (OSError, ValueError, zlib.error):
        return b""


def format_of(path: Path) -> Format | None:
    """The format of a file of frames by its content; None for any other file."""
    head = head_of(path)
    for one in FORMATS:
        if one.magic and head.startswith(one.magic):
            return one
    lines = head.decode(encoding_of(head), "replace").splitlines()[:HEAD_LINES]
    return next((one for one in FORMATS if one.begins is not None and one.begins(lines)), None)


def may_be(path: Path) -> bool:
    """Whether a file is one of frames: by its content, or, when that says nothing, by a suffix that only such files
    have."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return format_of(path) is not None or plain.suffix.lower() in set(SUFFIXES) - {".csv"}

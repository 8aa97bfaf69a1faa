"""Lines of a text file of any encoding, compressed or not, whose decoding never fails and whose lines are bounded."""

from __future__ import annotations

import codecs
import gzip
import io
from collections.abc import Iterator
from typing import IO, cast

from plumb.errors import UsageError

MOST_LINE = 1 << 16
"""Characters of one line of a table."""
_HEAD = 4096
_ONE_BYTE = "plumb-one-byte"
GZIP = b"\x1f\x8b"


def _as_cp1252(error: UnicodeError) -> tuple[str, int]:
    """Bytes that are no UTF-8 are characters of Windows' western code page, as in m/s² and °C of many loggers."""
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error(_ONE_BYTE, _as_cp1252)


def lines_of(name: str, file: IO[bytes]) -> Iterator[str]:
    """The lines of a binary file that is open at its beginning; a gzip file is expanded. name: for sentences. Raises
    UsageError for a file that is no text, and for a line that is longer than any of a table."""
    try:
        plain = cast(IO[bytes], gzip.GzipFile(fileobj=file)) if _head(file).startswith(GZIP) else file
        text = io.TextIOWrapper(plain, _encoding(name, _head(plain)), _ONE_BYTE)
        while line := text.readline(MOST_LINE):
            if len(line) == MOST_LINE:
                raise UsageError(f"{name} has a line of more than {MOST_LINE} characters: it is no table")
            yield line
    except (OSError, EOFError, UnicodeError) as error:
        raise UsageError(f"{name} is damaged, or no table of text ({str(error)[:80]})") from error


def _head(file: IO[bytes]) -> bytes:
    data = file.read(_HEAD)
    file.seek(0)
    return data


def _encoding(name: str, head: bytes) -> str:
    """Raises UsageError for bytes that are no text."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif head[1::2].count(0) * 3 > len(head) and not head[::2].count(0):
        encoding = "utf-16-le"
    elif head[::2].count(0) * 3 > len(head) and not head[1::2].count(0):
        encoding = "utf-16-be"
    else:
        encoding = "utf-8-sig"
    text = head.decode(encoding, "replace")
    odd = sum(one < " " and one not in "\t\n\r\f\x1b" for one in text)
    if odd * 50 > len(text) or text.count("\N{REPLACEMENT CHARACTER}") * 4 > len(text):
        raise UsageError(f"{name} is neither .npz nor readable CSV text: it begins with {head[:8].hex(' ')}")
    return encoding

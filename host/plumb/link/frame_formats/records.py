"""A frame of a text line as a record of `plumb.link.frame_records`, and what every family of formats has in common."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Protocol

from plumb.link.frame_records import ERROR, EXTENDED, PACK, REMOTE

MOST_S = 1e12
"""Seconds of the latest time that is read; a record holds 2^63 us."""
NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d{1,3})?", re.ASCII)
_HEX = re.compile(r"[0-9A-Fa-f]{1,8}", re.ASCII)

Lines = Callable[[], Iterator[str]]
"""The lines of a file from its beginning, without their ends."""


class LineReader(Protocol):
    """The reader of a family of text formats. fd: frames of CAN FD that it left out; note: what the user should know of
    how the file was read, "" for nothing."""

    fd: int
    note: str

    def record(self, line: str) -> bytes | None:
        """The record of a line; None for one without a frame. Raises ValueError, with the reason, for a frame that is
        not whole."""


def time_us(text: str, per_s: float = 1.0) -> int:
    """A time in microseconds. per_s: how many units of the text a second has. Raises ValueError."""
    if not NUMBER.fullmatch(text):
        raise ValueError(f"its time, {shown(text)}, is no number")
    seconds = float(text) / per_s
    if not -MOST_S < seconds < MOST_S:
        raise ValueError(f"its time, {shown(text)}, is out of range")
    return round(seconds * 1e6)


def identifier(text: str, base: int = 16) -> int:
    """An identifier without its flags. Raises ValueError."""
    if not _HEX.fullmatch(text) or (base == 10 and not text.isdigit()):
        raise ValueError(f"its identifier, {shown(text)}, is no number")
    value = int(text, base)
    if value >= EXTENDED:
        raise ValueError(f"its identifier, {shown(text)}, has more than 29 bits")
    return value


def length(text: str, base: int = 10) -> int:
    """A number of bytes, at most 64. Raises ValueError."""
    digits = text if _HEX.fullmatch(text) and (base == 16 or text.isdigit()) else ""
    if not digits or int(digits, base) > 64:
        raise ValueError(f"its length, {shown(text)}, is no number of bytes")
    return int(digits, base)


def bytes_of(words: list[str], size: int, base: int = 16) -> bytes:
    """The first `size` words as bytes. Raises ValueError for fewer, or for words that are no bytes."""
    if len(words) < size:
        raise ValueError(f"it has {len(words)} of {size} bytes")
    for word in words[:size]:
        if not _HEX.fullmatch(word) or (base == 10 and not word.isdigit()):
            raise ValueError(f"{shown(word)} is no byte")
    try:
        return bytes(int(word, base) for word in words[:size])
    except ValueError:
        raise ValueError("one of its bytes is above 255") from None


def packed(at_us: int, can_id: int, size: int, data: bytes, *, extended: bool, sent: bool, remote: bool) -> bytes:
    """A record of a classic frame. Raises ValueError for an identifier that its kind of frame does not have."""
    if not extended and can_id > 0x7FF:
        raise ValueError(f"its identifier, {can_id:X}, has more than 11 bits")
    if extended and can_id >= 1 << 29:
        raise ValueError(f"its identifier, {can_id:X}, has more than 29 bits")
    flags = EXTENDED * extended | REMOTE * remote
    return PACK(at_us, can_id | flags, min(size, 8), sent, b"" if remote else data[:8])


def error_frame(at_us: int) -> bytes:
    """A record of an error frame."""
    return PACK(at_us, ERROR, 0, 0, b"")


def shown(text: str) -> str:
    """A word of a file for a sentence: short, and in printable characters."""
    return ascii(text if len(text) <= 20 else text[:20] + "...")

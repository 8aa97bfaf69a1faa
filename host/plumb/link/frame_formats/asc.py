"""Vector's ASC: events behind their times, which are since the beginning of the measurement or since the event before.

Published descriptions and files of CANoe and CANalyzer are what this follows. CANoe writes every frame as CANFD where a
channel can do CAN FD; a flag says which of them are classic frames.
"""

from __future__ import annotations

import re

from plumb.link.frame_formats.records import Lines, bytes_of, error_frame, identifier, length, packed, time_us

_HEADER = re.compile(r"\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
_BEGINS = re.compile(r"\s*(?:date\s+\w+\s|base\s+(?:hex|dec)\b|begin\s+triggerblock\b)", re.IGNORECASE | re.ASCII)
_EVENT = re.compile(r"\s*(-?\d+\.\d+)\s+(.*)", re.ASCII)
_FRAME = re.compile(r"\d+\s+(?:\w+\s+(?:Rx|Tx)\b|ErrorFrame)|CANFD\s", re.ASCII | re.IGNORECASE)
_EDL, _RTR = 1 << 12, 1 << 4
"""Flags of a CANFD event: the frame is one of CAN FD; it is a remote frame."""


def begins(lines: list[str]) -> bool:
    """Whether the first lines of a file are of this format."""
    return any(_BEGINS.match(line) for line in lines) or any(_is_frame(line) for line in lines)


def _is_frame(line: str) -> bool:
    event = _EVENT.match(line)
    return event is not None and _FRAME.match(event[2]) is not None


class Reader:
    """Lines of ASC."""

    def __init__(self, _lines: Lines) -> None:
        self.fd, self.note = 0, ""
        self._base, self._relative, self._now_us = 16, False, 0

    def record(self, line: str) -> bytes | None:
        event = _EVENT.match(line)
        if event is None:
            header = _HEADER.match(line)
            if header is not None:
                self._base = 10 if header[1].lower() == "dec" else 16
                self._relative = (header[2] or "").lower() == "relative"
            return None
        at_us = time_us(event[1])
        if self._relative:
            at_us = self._now_us = self._now_us + at_us
        if _FRAME.match(event[2]) is None:
            return None
        words = event[2].split()
        return self._fd(at_us, words[1:]) if words[0].upper() == "CANFD" else self._classic(at_us, words[1:])

    def _classic(self, at_us: int, words: list[str]) -> bytes | None:
        """words: identifier, direction, d or r, DLC, bytes."""
        if words[0].lower() == "errorframe":
            return error_frame(at_us)
        if words[1].lower() == "txrq":
            return None  # the frame itself follows as Tx
        kind = words[2].lower() if len(words) > 2 else ""
        if kind not in ("d", "r"):
            raise ValueError("it is neither a frame with data nor a remote frame")
        size = min(length(words[3], self._base), 8) if len(words) > 3 else 0
        if kind == "d" and len(words) < 4:
            raise ValueError("it has no length")
        data = bytes_of(words[4:], size, self._base) if kind == "d" else b""
        return self._packed(at_us, words[0], size, data, words[1], remote=kind == "r")

    def _fd(self, at_us: int, words: list[str]) -> bytes | None:
        """words: channel, direction, identifier, perhaps a name, BRS, ESI, DLC, length, bytes, two others, flags."""
        if len(words) > 2 and words[2].lower() == "errorframe":
            return error_frame(at_us)
        if len(words) > 3 and not words[3].isdigit():
            del words[3]
        if len(words) < 7:
            raise ValueError("it ends before its length")
        if words[1].lower() == "txrq":
            return None
        size = length(words[6])
        data, after = bytes_of(words[7:], size, self._base), words[7 + size :]
        flags = identifier(after[2]) if len(after) > 2 else _EDL
        if flags & _EDL:
            self.fd += 1
            return None
        remote = bool(flags & _RTR) or (not size and length(words[5], 16) > 0)
        return self._packed(at_us, words[2], length(words[5], 16) if remote else size, data, words[1], remote=remote)

    def _packed(self, at_us: int, name: str, size: int, data: bytes, direction: str, *, remote: bool) -> bytes:
        extended = name[-1:].lower() == "x"
        can_id = identifier(name[:-1] if extended else name, self._base)
        return packed(at_us, can_id, size, data, extended=extended, sent=direction.lower() == "tx", remote=remote)

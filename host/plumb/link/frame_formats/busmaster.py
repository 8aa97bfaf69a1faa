"""BusMaster's log: header lines between stars, then a frame a line, its time in hours, minutes, seconds and 0.1 ms.

00:00:02:2992 Rx 1 0x406 s 8 CC 44 50 00 FB 20 82 F9
"""

from __future__ import annotations

import re

from plumb.link.frame_formats.records import Lines, bytes_of, identifier, length, packed, shown

_BEGINS = re.compile(r"\*\*\*(?:BUSMASTER\b|PROTOCOL CAN\b|\[START LOGGING SESSION\])")
_FRAME = re.compile(r"(\d{1,4}):(\d{1,2}):(\d{1,2}):(\d{1,4})\s+(Rx|Tx)\s+\d+\s+(\S+)\s+(\S+)\s+(\d+)(.*)", re.ASCII)
_TIME = re.compile(r"\d{1,4}:\d{1,2}:\d{1,2}:\d{1,4}\s", re.ASCII)
_KINDS = ("s", "x", "sr", "xr")


def begins(lines: list[str]) -> bool:
    """Whether the first lines of a file are of this format."""
    return any(_BEGINS.match(line) for line in lines)


class Reader:
    """Lines of a log of BusMaster."""

    def __init__(self, _lines: Lines) -> None:
        self.fd, self.note = 0, ""
        self._base, self._relative, self._now_us = 16, False, 0

    def record(self, line: str) -> bytes | None:
        line = line.strip()
        if line.startswith("***"):
            said = line.strip("*")
            self._base = {"HEX": 16, "DEC": 10}.get(said, self._base)
            self._relative = {"RELATIVE MODE": True, "ABSOLUTE MODE": False}.get(said, self._relative)
            return None
        found = _FRAME.fullmatch(line)
        if found is None:
            if not _TIME.match(line) or re.search(r"\b(?:ERR|Err)", line):
                return None
            raise ValueError(f"{shown(line)} is no frame of BusMaster")
        hours, minutes, seconds, tenths_ms = (int(part) for part in found.groups()[:4])
        at_us = ((hours * 60 + minutes) * 60 + seconds) * 1_000_000 + tenths_ms * 100
        if self._relative:
            at_us = self._now_us = self._now_us + at_us
        way, name, kind, size, rest = found.groups()[4:]
        if "fd" in kind.lower():
            self.fd += 1
            return None
        if kind.lower() not in _KINDS:
            raise ValueError(f"its kind, {shown(kind)}, is none of {', '.join(_KINDS)}")
        remote = kind.lower().endswith("r")
        count = length(size)
        if count > 8:
            self.fd += 1
            return None
        data = b"" if remote else bytes_of(rest.split(), count, self._base)
        prefixed = name.lower().startswith("0x")
        can_id = identifier(name[2:] if prefixed else name, 16 if prefixed else self._base)
        extended = kind.lower().startswith("x")
        return packed(at_us, can_id, count, data, extended=extended, sent=way == "Tx", remote=remote)

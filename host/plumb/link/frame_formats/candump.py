"""What candump of can-utils writes: its log files (-l, -L), and what it prints on a console, with any kind of time.

(1764300000.184877) can0 111#FE0100000A024000 R          -L
(1764300000.184877)  can0  111   [8]  FE 01 00           -ta; -tA has the date, -tz counts from the first frame
(000.001879)  can0  111   [8]  FE 01 00                  -td: since the frame before
can0  111   [8]  FE 01 00                                without a time
"""

from __future__ import annotations

import re
from datetime import UTC, datetime

from plumb.link.frame_formats.records import Lines, bytes_of, error_frame, identifier, length, packed, shown, time_us

_LOG = re.compile(r"\s*\((\d+\.\d+)\)\s+(\S+)\s+([0-9A-Fa-f]+)#(\S*)(?:\s+([RTrt]))?\s*", re.ASCII)
_CONSOLE = re.compile(
    r"\s*(?:\(([^()]{1,40})\)\s+)?(\S+)\s+(?:(RX|TX)\s+\S\s+\S\s+)?([0-9A-Fa-f]{3,8})\s+\[(\d{1,2})\](.*)", re.ASCII
)
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_DATE = re.compile(r"(\d{4})-(\d\d)-(\d\d) (\d\d):(\d\d):(\d\d)\.(\d{1,6})", re.ASCII)
_REMOTE = re.compile(r"[Rr](\d?)(?:_\w)?", re.ASCII)
_ERROR = 1 << 29
SHORT_S = 1e6
"""Times below are since a frame, not since 1970."""


def begins(lines: list[str]) -> bool:
    """Whether the first lines of a file are of this format."""
    return any(_LOG.fullmatch(line) or _CONSOLE.match(_COLOUR.sub("", line)) for line in lines)


class Reader:
    """Lines of candump, of any kind."""

    def __init__(self, lines: Lines) -> None:
        self.fd, self.note = 0, ""
        self._now_us = 0
        self._sums = _are_differences(lines)
        if self._sums:
            self.note = "its times are differences (candump -td): they are summed"

    def record(self, line: str) -> bytes | None:
        line = _COLOUR.sub("", line) if "\x1b" in line else line
        if not line.strip() or line.lstrip().startswith("#"):
            return None
        logged = _LOG.fullmatch(line)
        if logged is not None:
            return self._of_log(*logged.groups(""))
        printed = _CONSOLE.fullmatch(line)
        if printed is None:
            raise ValueError(f"{shown(line.strip())} is no frame of candump")
        return self._of_console(*printed.groups(""))

    def _of_log(self, at: str, _channel: str, name: str, data: str, direction: str) -> bytes | None:
        if data.startswith("#"):
            self.fd += 1
            return None
        at_us, can_id = time_us(at), int(name, 16) if len(name) in (3, 8) else -1
        if can_id < 0:
            raise ValueError(f"its identifier, {shown(name)}, has neither 3 nor 8 digits")
        if len(name) == 8 and can_id & _ERROR:
            return error_frame(at_us)
        remote = _REMOTE.fullmatch(data)
        digits = data.partition("_")[0].replace(".", "")
        if remote is None and (len(digits) % 2 or len(digits) > 16):
            raise ValueError(f"its data, {shown(data)}, is not 0 to 8 bytes")
        words = [] if remote is not None else [digits[place : place + 2] for place in range(0, len(digits), 2)]
        size = int(remote[1] or 0) if remote is not None else len(words)
        held = bytes_of(words, len(words))
        return packed(
            at_us,
            can_id,
            size,
            held,
            extended=len(name) == 8,
            sent=direction.upper() == "T",
            remote=remote is not None,
        )

    def _of_console(self, at: str, _channel: str, way: str, name: str, size: str, rest: str) -> bytes | None:
        at_us = _console_us(at)
        if self._sums:
            at_us = self._now_us = self._now_us + at_us
        if len(size) == 2:
            self.fd += 1  # candump writes the length of CAN FD with two digits
            return None
        can_id, count = int(name, 16), length(size)
        if can_id & _ERROR and len(name) == 8:
            return error_frame(at_us)
        remote = rest.strip().startswith("remote request")
        data = b"" if remote else bytes_of(rest.split(), count)
        extended = len(name) == 8
        can_id = identifier(name)
        return packed(at_us, can_id, count, data, extended=extended, sent=way == "TX", remote=remote)


def _console_us(text: str) -> int:
    """A time of the console; 0 where there is none. Raises ValueError."""
    text = text.strip()
    if not text:
        return 0
    date = _DATE.fullmatch(text)
    if date is None:
        return time_us(text)
    year, month, day, hour, minute, second = (int(part) for part in date.groups()[:6])
    whole = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    return round(whole.timestamp()) * 1_000_000 + int(date[7].ljust(6, "0"))


def _are_differences(lines: Lines) -> bool:
    """Whether times on a console are since the frame before: they fall again and again, or are all the same after the
    first; those since the first frame rise."""
    before = first = -1
    count = falls = same = 0
    for line in lines():
        printed = _CONSOLE.match(line)
        if printed is None or not printed[1]:
            if count or _LOG.match(line):
                break
            continue
        try:
            at_us = _console_us(printed[1])
        except ValueError:
            break
        if at_us >= SHORT_S * 1e6:
            return False
        first = at_us if count == 1 else first
        falls += at_us < before
        same += at_us == first > 0
        before, count = at_us, count + 1
    return falls > count // 20 or (count > 2 and same == count - 1)

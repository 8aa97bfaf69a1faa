"""PEAK's TRC, versions 1.0 to 3.0: a table of messages, whose columns the version or the line $COLUMNS names.

PEAK's published description of the format is what this follows.
"""

from __future__ import annotations

import re

from plumb.errors import UsageError
from plumb.link.frame_formats.records import Lines, bytes_of, identifier, length, packed, shown, time_us

_VERSIONS = {"1.0": "NOILD", "1.1": "NOTILD", "1.2": "NOBTILD", "1.3": "NOBTIRLD"}
"""Columns by version, a letter each; later versions declare theirs: N number, O offset in ms, B bus, T type,
I identifier, d direction, R reserved, L DLC, l length in bytes, D data."""
_KEYWORD = re.compile(r";\s*\$(FILEVERSION|STARTTIME|COLUMNS)\s*=\s*([^;\s]*)", re.IGNORECASE | re.ASCII)
_ROW = re.compile(r"\s*\d+\)\s+\d+(?:\.\d+)?\s+\S", re.ASCII)
_DATA, _REMOTE, _FD = ("RX", "TX", "DT"), ("RR",), ("FD", "FB", "FE", "BI")
_EPOCH_DAYS = 25569.0
"""1970-01-01 counted from 1899-12-30."""
_LONG_DAYS = 1e6


def begins(lines: list[str]) -> bool:
    """Whether the first lines of a file are of this format."""
    return any(_KEYWORD.match(line) for line in lines) or any(_ROW.match(line) for line in lines)


class Reader:
    """Lines of TRC."""

    def __init__(self, _lines: Lines) -> None:
        self.fd, self.note = 0, ""
        self._start_us, self._columns = 0, ""
        self._choose("1.0", "")

    def _choose(self, version: str, columns: str) -> None:
        """Where each column is. columns: as the file declares them."""
        letters = _VERSIONS.get(version) or columns.replace(",", "")
        self._version, self._declared = version, columns
        self._place = {letter: place for place, letter in enumerate(letters)}

    def record(self, line: str) -> bytes | None:
        line = line.strip()
        if line.startswith(";"):
            self._keyword(line)
            return None
        return self._row(line.split()) if line else None

    def _keyword(self, line: str) -> None:
        found = _KEYWORD.match(line)
        if found is None:
            return
        name, value = found[1].upper(), found[2]
        if name == "FILEVERSION":
            self._choose(value, self._declared)
        elif name == "COLUMNS":
            self._choose(self._version, value[:80])
        else:
            try:
                days = float(value)
            except ValueError:
                return
            known = 0 < days < _LONG_DAYS
            self._start_us = round((days - _EPOCH_DAYS) * 86400e6) if known else 0

    def _row(self, words: list[str]) -> bytes | None:
        place = self._place
        if not {"O", "I"} <= place.keys() or not place.keys() & {"L", "l"}:
            raise UsageError(
                f"version {shown(self._version)} of TRC is not known, and no line $COLUMNS names its columns; save it "
                "as version 2.1"
            )
        data_at = place.get("D", len(place))
        if len(words) < data_at:
            raise ValueError(f"it has {len(words)} of {data_at} columns")
        kind = words[place["T"]].upper() if "T" in place else "DT"
        if kind in _FD:
            self.fd += 1
            return None
        name = words[place["I"]]
        if kind not in (*_DATA, *_REMOTE) or name == "FFFFFFFF":
            return None  # a warning, an error or a state of the bus
        size = length(words[place["l" if "l" in place else "L"]])
        if size > 8:
            return None  # a message of J1939 that was put together
        rest = words[data_at:]
        remote = kind in _REMOTE or rest[:1] == ["RTR"]
        at_us = self._start_us + time_us(words[place["O"]], 1e3)
        data = b"" if remote else bytes_of(rest, size)
        way = words[place["d"]].upper() if "d" in place else kind
        return packed(at_us, identifier(name), size, data, extended=len(name) > 4, sent=way == "TX", remote=remote)

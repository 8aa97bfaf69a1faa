"""Tables of frames with commas: python-can's CSV, and the GVRET CSV of SavvyCAN."""

from __future__ import annotations

import base64
import binascii

from plumb.link.frame_formats.records import Lines, bytes_of, error_frame, identifier, length, packed, shown, time_us

PYTHON_CAN = ("timestamp", "arbitration_id", "extended", "remote", "error", "dlc", "data")
_GVRET = ("time stamp", "id", "extended")
_TRUE = ("1", "true")


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split(",")]


def _names(lines: list[str]) -> tuple[str, ...]:
    return tuple(_cells(lines[0].lower())) if lines else ()


def begins_python_can(lines: list[str]) -> bool:
    """Whether the first line of a file is the header of python-can's CSV."""
    return _names(lines) == PYTHON_CAN


def begins_gvret(lines: list[str]) -> bool:
    """Whether the first line of a file is the header of a GVRET CSV."""
    names = _names(lines)
    return names[:3] == _GVRET and "len" in names and "d1" in names


class PythonCan:
    """Lines of python-can's CSV: seconds, and the data in base64."""

    def __init__(self, _lines: Lines) -> None:
        self.fd, self.note = 0, ""

    def record(self, line: str) -> bytes | None:
        cells = _cells(line)
        if cells == [""] or cells[0] == PYTHON_CAN[0]:
            return None
        if len(cells) != len(PYTHON_CAN):
            raise ValueError(f"it has {len(cells)} of {len(PYTHON_CAN)} columns")
        at_us, size = time_us(cells[0]), length(cells[5])
        extended, remote, error = (cell in _TRUE for cell in cells[2:5])
        if error:
            return error_frame(at_us)
        try:
            data = base64.b64decode(cells[6], validate=True)
        except (binascii.Error, ValueError):
            raise ValueError(f"its data, {shown(cells[6])}, is no base64") from None
        if len(data) > 8 or size > 8:
            self.fd += 1
            return None
        if not remote and len(data) != size:
            raise ValueError(f"it has {len(data)} of {size} bytes")
        can_id = identifier(cells[1].lower().removeprefix("0x"))
        return packed(at_us, can_id, size, data, extended=extended, sent=False, remote=remote)


class Gvret:
    """Lines of a GVRET CSV: microseconds, and a column for each byte. Older ones have no column Dir."""

    def __init__(self, _lines: Lines) -> None:
        self.fd, self.note = 0, ""
        self._place: dict[str, int] = {}

    def record(self, line: str) -> bytes | None:
        cells = _cells(line)
        if cells == [""]:
            return None
        if not self._place:
            self._place = {name.lower(): place for place, name in enumerate(cells[:80])}
            return None
        place = self._place
        first = place["d1"]
        if len(cells) < first:
            raise ValueError(f"it has {len(cells)} of {first} columns before its data")
        at_us, size = time_us(cells[0], 1e6), length(cells[place["len"]])
        if size > 8:
            self.fd += 1
            return None
        data = bytes_of([cell for cell in cells[first:] if cell], size)
        sent = "dir" in place and cells[place["dir"]].lower() == "tx"
        can_id = identifier(cells[place["id"]].lower().removeprefix("0x"))
        extended = cells[place["extended"]].lower() in _TRUE
        return packed(at_us, can_id, size, data, extended=extended, sent=sent, remote=False)

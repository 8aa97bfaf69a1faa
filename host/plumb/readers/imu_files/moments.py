"""Stamps written as a date with a time, or as a time of day."""

from __future__ import annotations

import math
import re
from datetime import date

DAY_S = 86400.0
_TIME = r"(\d{1,2})[:\-](\d{2})[:\-](\d{2})(?:[.,:_](\d{1,9}))?\s*([AaPp][Mm])?"
_ZONE = r"\s*(?:(Z|UTC|GMT)|([-+])(\d{2}):?(\d{2})?)?"
_DATED = re.compile(rf"(\d{{4}})[-/.](\d{{1,2}})[-/.](\d{{1,2}})[T_ ]+{_TIME}{_ZONE}")
_DAY_FIRST = re.compile(rf"(\d{{1,2}})[-/.](\d{{1,2}})[-/.](\d{{4}})[T_, ]+{_TIME}{_ZONE}")
_OF_DAY = re.compile(rf"{_TIME}{_ZONE}")


class Moments:
    """Seconds from the first stamp on. Times of day go on over midnight. Days of a date without its order, 03/04/2026,
    are taken as day and month; a month above 12 is the day."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._last_s, self._midnights = 0.0, 0

    def seconds(self, text: str) -> float:
        """Raises ValueError for a text that is no stamp."""
        if not text:
            return math.nan
        dated, day, second_s = _parsed(text.strip())
        if not dated:
            self._midnights += second_s < self._last_s - DAY_S / 2.0
            self._last_s, day = second_s, self._midnights
        if self._first is None:
            self._first = day, second_s
        return (day - self._first[0]) * DAY_S + second_s - self._first[1]


def is_moment(text: str) -> bool:
    try:
        _parsed(text.strip())
    except ValueError:
        return False
    return True


def _parsed(text: str) -> tuple[bool, int, float]:
    """Whether it has a date; the day, as `date.toordinal`; the second of the day, UTC where a zone stands."""
    if found := _DATED.fullmatch(text):
        year, month, day = (int(one) for one in found.groups()[:3])
        return True, date(year, month, day).toordinal(), _second_s(found.groups()[3:])
    if found := _DAY_FIRST.fullmatch(text):
        day, month, year = (int(one) for one in found.groups()[:3])
        day, month = (month, day) if month > 12 else (day, month)
        return True, date(year, month, day).toordinal(), _second_s(found.groups()[3:])
    if found := _OF_DAY.fullmatch(text):
        return False, 0, _second_s(found.groups())
    raise ValueError(text)


def _second_s(parts: tuple[str | None, ...]) -> float:
    hour, minute, second, fraction, half, _, sign, zone_h, zone_min = parts
    hours = int(hour or 0) % 12 + 12 * (half.lower() == "pm") if half else int(hour or 0)
    zone_s = (
        0.0 if sign is None else (1.0 if sign == "+" else -1.0) * (int(zone_h or 0) * 3600 + int(zone_min or 0) * 60)
    )
    whole_s = hours * 3600 + int(minute or 0) * 60 + int(second or 0)
    return whole_s + (float(f"0.{fraction}") if fraction else 0.0) - zone_s

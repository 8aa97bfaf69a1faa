"""Disturbances of a run as text: KIND[:WHAT]@START[-STOP], times in seconds.

    stuck:NAME@20        a channel freezes at 20 s, for good
    railed:NAME@20-25    a channel is at its rail for 5 s
    push:0.2@15-15.3     a push of that size, in the unit of the system

Each system says which kinds it has and what they act on (FAULTS of plumb.systems).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from plumb.errors import UsageError

_FORM = re.compile(r"(?P<kind>[a-z]+)(:(?P<what>[^@]+))?@(?P<start>[0-9.]+)(-(?P<stop>[0-9.]+))?")


@dataclass(frozen=True)
class Request:
    """One disturbance, active for start_s <= time < stop_s."""

    kind: str
    what: str
    start_s: float
    stop_s: float

    def number(self, unit: str) -> float:
        """`what` as a finite number; raises UsageError, which names the unit."""
        try:
            value = float(self.what)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise UsageError(f"{self.kind}:{self.what}: give a number of {unit}")
        return value


def parse(text: str) -> Request:
    """The disturbance that the text describes; raises UsageError, which shows the form, for any other text."""
    found = _FORM.fullmatch(text)
    try:
        assert found
        start_s, stop_s = float(found["start"]), float(found["stop"] or "inf")
        assert start_s < stop_s
    except (AssertionError, ValueError):
        raise UsageError(
            f"'{text}' is no fault; write KIND[:WHAT]@START[-STOP], for example stuck:CHANNEL@20-25"
        ) from None
    return Request(found["kind"], found["what"] or "", start_s, stop_s)

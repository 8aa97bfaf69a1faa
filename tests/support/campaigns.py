"""Long campaigns: a sample of each in every run of the tests, the whole with PLUMB_LONG=1."""

from __future__ import annotations

import os

LONG = os.environ.get("PLUMB_LONG") == "1"


def campaign(sample: int, whole: int) -> int:
    """How many cases to take."""
    return whole if LONG else sample

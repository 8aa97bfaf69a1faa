"""Time that passes at a fifth of the wall clock's pace, for tests of what keeps up with it.

A process that lives in slow time finds its samples, keep-alives and time-outs five times further apart, and has the
same work to do: a test of several such processes passes on a machine that is five times slower, and when a process is
paused for two seconds. `python -m support.slow_time VERB ...` is `plumb VERB ...` in slow time. A host that only asks a
board, over its UART, may be slow alone: it then waits longer for its answers.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import SupportsIndex

import pytest

PACE = 0.2
"""Seconds that pass in a second of the wall clock."""
SHORT_REST_S = 0.005
TESTS = Path(__file__).resolve().parents[1]

_wall_s, _rest = time.monotonic, time.sleep


def slow_monotonic(*_: object) -> float:
    """pyserial keeps the clock as an attribute of a class, and so calls it as a method."""
    return PACE * _wall_s()


def slow_sleep(seconds: float | SupportsIndex) -> None:
    """A short rest between two looks stays as short: nothing is to happen in it."""
    wanted_s = float(seconds)
    _rest(wanted_s if wanted_s < SHORT_REST_S else wanted_s / PACE)


def command(*arguments: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of `plumb ARGUMENTS` in slow time."""
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    return [sys.executable, "-m", "support.slow_time", *arguments], {**os.environ, "PYTHONPATH": path}


def in_wall_time(*arguments: str) -> tuple[list[str], dict[str, str]]:
    """The same for what need not keep up with anything."""
    return [sys.executable, "-m", "plumb", *arguments], dict(os.environ)


def slow_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rest of a test in slow time: all that it makes from here on."""
    monkeypatch.setattr(time, "monotonic", slow_monotonic)
    monkeypatch.setattr(time, "sleep", slow_sleep)


def begin() -> None:
    """This process in slow time, before it imports anything that reads a clock."""
    time.monotonic, time.sleep = slow_monotonic, slow_sleep


if __name__ == "__main__":
    begin()
    from plumb.__main__ import entry

    sys.argv[0] = "plumb"
    entry()

"""A closed loop swept on a board: one run in lockstep, in which one sine follows the other.

A sine is added to the commands that the board gives its actuators, in the pattern of one loop. What the board answers
in that pattern, by what the actuators get, is minus the loop's gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.tuning.loop_model import Response

SETTLES_S, MEASURED_S, PERIODS = 0.5, 1.5, 3
"""Before a sine is measured; then for so long at least, and for so many of its periods."""
CORNER_HZ, LARGEST = 8.0, 4.0
"""Above the corner a sine grows with its frequency, since the loop follows it less; at most to LARGEST times."""


@dataclass(frozen=True)
class Sine:
    """One frequency: begun at begin_s, measured from measured_s to end_s, whole periods."""

    hz: float
    amplitude: float
    begin_s: float
    measured_s: float
    end_s: float

    def added(self, time_s: float) -> float:
        return self.amplitude * math.sin(2.0 * math.pi * self.hz * (time_s - self.begin_s))


class BrokenLoop(Protocol):
    """A vehicle under a board, step by step."""

    def command(self, time_s: float) -> float:
        """Simulate up to time_s, let the board take its step, and return what it gives in the pattern."""

    def drive(self, added: float) -> float:
        """Let the vehicle go on with that command and the sine; what it gets in the pattern, limits included."""


def sines(amplitude: float, frequencies: FloatArray, begin_s: float) -> list[Sine]:
    """One after the other from begin_s on. amplitude: up to CORNER_HZ."""
    found, now_s = [], begin_s
    for hz in frequencies.tolist():
        whole = max(math.ceil(MEASURED_S * hz), PERIODS)
        size = amplitude * min(max(hz / CORNER_HZ, 1.0), LARGEST)
        found.append(Sine(hz, size, now_s, now_s + SETTLES_S, now_s + SETTLES_S + whole / hz))
        now_s = found[-1].end_s
    return found


def swept(loop: BrokenLoop, plan: Sequence[Sine], steps: int, period_s: float) -> Response:
    """Gain of the loop at the frequencies of the plan."""
    given, got = np.zeros(len(plan), np.complex128), np.zeros(len(plan), np.complex128)
    at = 0
    for step in range(steps):
        time_s = step * period_s
        own = loop.command(time_s)
        while at < len(plan) - 1 and time_s >= plan[at].end_s:
            at += 1
        sine = plan[at]
        driven = loop.drive(sine.added(time_s) if time_s >= sine.begin_s else 0.0)
        if sine.measured_s <= time_s < sine.end_s:
            turned = np.exp(-2j * np.pi * sine.hz * time_s)
            given[at] += own * turned
            got[at] += driven * turned
    return np.asarray(-given / got)

"""A hand that holds a body at a tilt, and turns it to another when it is asked to."""

from __future__ import annotations

import math


class Hand:
    """tilt and rate over time; a turn is smooth, and the body is at rest before and after it.

    time_s: the latest time that was asked for, at which the next turn begins.
    """

    def __init__(self, tilt_deg: float = 0.0) -> None:
        self.time_s = 0.0
        self._from_deg = self._to_deg = tilt_deg
        self._begin_s, self._turn_s = 0.0, 1.0

    def turn_to(self, tilt_deg: float, over_s: float = 1.0, wait_s: float = 0.0) -> None:
        """Turn to this tilt within over_s, beginning wait_s from now."""
        self._from_deg = self.at(self.time_s)[0]
        self._to_deg, self._begin_s, self._turn_s = tilt_deg, self.time_s + wait_s, over_s

    def at(self, time_s: float) -> tuple[float, float]:
        """Tilt in degrees and rate in deg/s."""
        self.time_s = max(self.time_s, time_s)
        share = min(max((time_s - self._begin_s) / self._turn_s, 0.0), 1.0)
        way_deg = self._to_deg - self._from_deg
        tilt_deg = self._from_deg + way_deg * (1.0 - math.cos(math.pi * share)) / 2.0
        return tilt_deg, way_deg * math.pi / 2.0 * math.sin(math.pi * share) / self._turn_s

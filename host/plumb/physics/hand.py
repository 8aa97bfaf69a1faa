"""A hand that holds a body in a pose, and turns it to another one on request.

A turn is smooth; the body is at rest before and after it. A turn begins at the latest time for which the pose was read.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Protocol

import numpy as np

from plumb.spec.arrays import FloatArray

TURN_S = 1.0
"""Default time of a turn."""


class Hand(Protocol):
    """poses: the names of the poses that it knows."""

    @property
    def poses(self) -> tuple[str, ...]: ...

    def put(self, pose: str, over_s: float = TURN_S, share: float = 1.0) -> None:
        """Turn it towards this pose within over_s. share: of the way; 0.5 stops half-way."""


class _Way:
    """The course of a turn: its share from 0 to 1 over time, a raised cosine."""

    def __init__(self) -> None:
        self._begin_s, self._over_s, self._now_s = 0.0, TURN_S, 0.0

    def begin(self, over_s: float) -> None:
        self._begin_s, self._over_s = self._now_s, over_s

    def at(self, time_s: float) -> tuple[float, float]:
        """Share, and its growth per second."""
        self._now_s = max(self._now_s, time_s)
        into = min(max((time_s - self._begin_s) / self._over_s, 0.0), 1.0)
        growth = math.pi / 2.0 * math.sin(math.pi * into) / self._over_s
        return (1.0 - math.cos(math.pi * into)) / 2.0, growth

    def now(self) -> float:
        return self.at(self._now_s)[0]


class TiltingHand:
    """Holds a body that tilts about one axis. tilts_deg: pose -> tilt; it begins in the first one."""

    def __init__(self, tilts_deg: Mapping[str, float]) -> None:
        self._tilts_deg = dict(tilts_deg)
        self._from_deg = next(iter(self._tilts_deg.values()))
        self._way_deg = 0.0
        self._way = _Way()

    @property
    def poses(self) -> tuple[str, ...]:
        return tuple(self._tilts_deg)

    def put(self, pose: str, over_s: float = TURN_S, share: float = 1.0) -> None:
        self._from_deg += self._way_deg * self._way.now()
        self._way_deg = share * (self._tilts_deg[pose] - self._from_deg)
        self._way.begin(over_s)

    def at(self, time_s: float) -> tuple[float, float]:
        """Tilt in degrees and rate in deg/s."""
        share, growth = self._way.at(time_s)
        return self._from_deg + self._way_deg * share, self._way_deg * growth


class TurningHand:
    """Holds a body in space. ups: pose -> axis of the body that points up, of length 1; it begins in the first one.

    Turns are the shortest ones: about the horizontal axis that carries one vertical to the other."""

    def __init__(self, ups: Mapping[str, Iterable[float]]) -> None:
        self._ups = {name: np.array(list(up), np.float64) for name, up in ups.items()}
        self._from: FloatArray = next(iter(self._ups.values()))
        self._axis, self._angle_rad = np.array([1.0, 0.0, 0.0]), 0.0
        self._way = _Way()

    @property
    def poses(self) -> tuple[str, ...]:
        return tuple(self._ups)

    def put(self, pose: str, over_s: float = TURN_S, share: float = 1.0) -> None:
        self._from = self._up(self._way.now())
        target = self._ups[pose]
        axis = np.cross(target, self._from)
        length = float(np.linalg.norm(axis))
        self._angle_rad = share * math.atan2(length, float(np.dot(target, self._from)))
        if length < 1e-9:  # the same pose or the opposite one: any horizontal axis will do
            axis = np.cross(self._from, np.roll(np.abs(self._from).round(), 1))
            length = float(np.linalg.norm(axis))
        self._axis = axis / length
        self._way.begin(over_s)

    def at(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """The vertical in body axes, and the rates about them in deg/s."""
        share, growth = self._way.at(time_s)
        return self._up(share), self._axis * (math.degrees(self._angle_rad) * growth)

    def _up(self, share: float) -> FloatArray:
        """The vertical after this share of the turn; it is perpendicular to the axis."""
        angle = self._angle_rad * share
        return np.asarray(self._from * math.cos(angle) + np.cross(self._from, self._axis) * math.sin(angle))

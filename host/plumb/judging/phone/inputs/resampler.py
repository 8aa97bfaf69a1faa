"""Resample two sensors to steps of a constant period by the time stamps of the phone.

A step is the mean, over one period around its instant, of the linear interpolation between samples. Fast motion does
not alias, a lost sample is interpolated, and arrival times do not matter; no clock is read.

A step is made when both sensors are WAIT_S beyond it, so samples that are reordered by less are used. A sample that
arrives after its step was made is late and dropped. A gap of more than GAP_S in a sensor, or a clock that goes back for
BACKWARD samples in a row, begins a new run.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

from plumb.judging.phone.inputs.apps import Sample, Sensor, Vector

WAIT_S = 0.02
GAP_S = 1.0
BACKWARD = 20
MOST_WAITING = 1 << 14
"""Samples of one sensor that wait for the other: those of GAP_S, far above the rate of any phone. One more begins a new
run."""
SENSORS: tuple[Sensor, Sensor] = ("gyro", "accel")


@dataclass(frozen=True, slots=True)
class Step:
    """The mean values of one period. first: the step begins a run, and time_s counts from it."""

    first: bool
    time_s: float
    rate_dps: Vector
    force_g: Vector


@dataclass
class Counts:
    """Counts of samples used and dropped."""

    samples: dict[Sensor, int] = field(default_factory=lambda: {"gyro": 0, "accel": 0})
    reordered: int = 0
    late: int = 0
    duplicate: int = 0
    runs: int = 0
    longest_gap_s: float = 0.0
    """Between neighbouring samples of one sensor, within a run."""


class _Track:
    """Samples of one sensor in order of time."""

    def __init__(self) -> None:
        self.time_s: list[float] = []
        self.xyz: list[Vector] = []

    def insert(self, sample: Sample) -> bool:
        """Insert a sample; False if there is one with that time stamp already."""
        at = bisect_left(self.time_s, sample.time_s)
        if at < len(self.time_s) and self.time_s[at] == sample.time_s:
            return False
        self.time_s.insert(at, sample.time_s)
        self.xyz.insert(at, sample.xyz)
        return True

    def at(self, time_s: float) -> Vector:
        """Linear interpolation at time_s, which must lie within the samples."""
        i = min(max(bisect_right(self.time_s, time_s) - 1, 0), len(self.time_s) - 2)
        share = (time_s - self.time_s[i]) / (self.time_s[i + 1] - self.time_s[i])
        (ax, ay, az), (bx, by, bz) = self.xyz[i], self.xyz[i + 1]
        return ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az)

    def mean(self, begin_s: float, end_s: float) -> Vector:
        """Mean of the linear interpolation over an interval within the samples."""
        first, last = bisect_right(self.time_s, begin_s), bisect_left(self.time_s, end_s)
        times = [begin_s, *self.time_s[first:last], end_s]
        points = [self.at(begin_s), *self.xyz[first:last], self.at(end_s)]
        total = [0.0, 0.0, 0.0]
        for (t0, p0), (t1, p1) in zip(
            zip(times, points, strict=True), zip(times[1:], points[1:], strict=True), strict=False
        ):
            for axis in range(3):
                total[axis] += 0.5 * (p0[axis] + p1[axis]) * (t1 - t0)
        x, y, z = (part / (end_s - begin_s) for part in total)
        return x, y, z

    def forget_before(self, time_s: float) -> float:
        """Drop old samples, except one at or before time_s; returns the longest gap among the dropped ones, s."""
        keep = max(bisect_right(self.time_s, time_s) - 1, 0)
        gaps = [later - earlier for earlier, later in zip(self.time_s, self.time_s[1 : keep + 1], strict=False)]
        del self.time_s[:keep], self.xyz[:keep]
        return max(gaps, default=0.0)


class Resampler:
    """Converts samples, fed in order of arrival, to steps."""

    def __init__(self, period_us: int) -> None:
        self.period_s = period_us * 1e-6
        self.counts = Counts()
        self._tracks: dict[Sensor, _Track] = {}
        self._begin()

    def _begin(self) -> None:
        self._tracks = {sensor: _Track() for sensor in SENSORS}
        self._origin_s: float | None = None
        self._made = 0
        self._backward = 0

    def feed(self, sample: Sample) -> Iterator[Step]:
        """The steps that this sample completes, often none."""
        self.counts.samples[sample.sensor] += 1
        made_s, newest_s = self._edge_s(self._made), self._newest_s()
        if made_s is not None and sample.time_s < max(made_s, newest_s - GAP_S):
            self.counts.late += 1
            self._backward += 1
            if self._backward < BACKWARD:
                return
            self._begin()
        elif abs(sample.time_s - newest_s) > GAP_S:
            self._begin()
        self._backward = 0
        track = self._tracks[sample.sensor]
        self.counts.reordered += bool(track.time_s) and sample.time_s < track.time_s[-1]
        if len(track.time_s) >= MOST_WAITING:
            self._begin()
            track = self._tracks[sample.sensor]
        if not track.insert(sample):
            self.counts.duplicate += 1
            return
        if any(other.time_s and other.time_s[-1] < self._newest_s() - GAP_S for other in self._tracks.values()):
            self._begin()
            self._tracks[sample.sensor].insert(sample)
        yield from self._ready(WAIT_S)

    def finish(self) -> Iterator[Step]:
        """The remaining steps, after the last sample."""
        yield from self._ready(0.0)

    def _newest_s(self) -> float:
        return max((track.time_s[-1] for track in self._tracks.values() if track.time_s), default=math.inf)

    def _edge_s(self, made: int) -> float | None:
        """Begin of the averaging interval of step `made`."""
        return None if self._origin_s is None else self._origin_s + made * self.period_s

    def _ready(self, wait_s: float) -> Iterator[Step]:
        tracks = self._tracks
        if self._origin_s is None:
            if any(len(track.time_s) < 2 for track in tracks.values()):
                for track in tracks.values():
                    track.forget_before(self._newest_s() - GAP_S)
                return
            self._origin_s = max(track.time_s[0] for track in tracks.values())
        while True:
            begin_s, end_s = self._edge_s(self._made), self._edge_s(self._made + 1)
            assert begin_s is not None and end_s is not None
            if min(track.time_s[-1] for track in tracks.values()) < end_s + wait_s:
                return
            rate_dps, force_g = (tracks[sensor].mean(begin_s, end_s) for sensor in SENSORS)
            first, self._made = self._made == 0, self._made + 1
            self.counts.runs += first
            gaps = [track.forget_before(end_s) for track in tracks.values()]
            self.counts.longest_gap_s = max(self.counts.longest_gap_s, *gaps)
            yield Step(first, (self._made - 1) * self.period_s, rate_dps, force_g)

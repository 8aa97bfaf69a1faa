"""Find out which conversions of the board's analog inputs belong to a sample, for a plant on the pins.

The board scans its inputs at least once per millisecond, whatever its period. The last scan of a period is the sample;
the others only detect an input at a rail or stuck. A plant draws noise once per sample. Every other scan needs
converter noise of its own; otherwise the input would look stuck for a whole period.
"""

from __future__ import annotations

import random

from plumb.contract.scenario import Plant
from plumb.physics.sensors import ADC_COUNTS, ADC_NOISE_LSB, ADC_REFERENCE_V
from plumb.systems.contracts import Conversion

SCAN_INTERVAL_US = 1000
"""Longest time between two scans."""
SAME_SCAN_S = 100e-6
"""Longest gap between conversions of one scan, and between scans of one oversampled sample."""
TOLERANCE_S = 3e-6


class AnalogScans:
    """Tracks the conversions of the first channel. A scan that does not follow the last one by one interval is the
    first of a new run, for which the board restarted its timer."""

    def __init__(self, period_us: int, seed: int) -> None:
        self.per_period = -(-period_us // SCAN_INTERVAL_US)
        self.interval_s = period_us * 1e-6 / self.per_period
        self._last_s: float | None = None
        self._scans = 0
        self._chance = random.Random(seed)

    def until_sample_s(self) -> float:
        """Time in s from this scan to the next sample; 0 if this scan is the sample."""
        return -self._scans % self.per_period * self.interval_s

    def convert(self, now_s: float) -> bool:
        """Report a conversion of the first channel. Returns True if it begins a new scan."""
        after_s = None if self._last_s is None else now_s - self._last_s
        if after_s is not None and after_s < SAME_SCAN_S:
            return False
        in_time = after_s is not None and abs(after_s - self.interval_s) < TOLERANCE_S
        self._scans = self._scans + 1 if in_time else 1
        self._last_s = now_s
        return True

    @property
    def is_sample(self) -> bool:
        return self._scans % self.per_period == 0

    def noise_v(self) -> float:
        """Converter noise in V for one conversion between two samples."""
        return 0.0 if self.is_sample else self._chance.gauss(0.0, ADC_NOISE_LSB * ADC_REFERENCE_V / ADC_COUNTS)


class SampledPlant:
    """A plant whose time 0 is the first sample of the first channel. taken: the samples of that channel."""

    def __init__(self, plant: Plant, period_us: int) -> None:
        self.sampled = plant
        self.taken: list[Conversion] = []
        self._start_s: float | None = None
        self._scans = AnalogScans(period_us, 0)

    def time_s(self, now_s: float) -> float:
        """Of the plant, at a time of the machine, both in s."""
        return 0.0 if self._start_s is None else max(0.0, now_s - self._start_s)

    def count(self, now_s: float, channel: int = 0) -> int:
        return int(self.sampled.counts(self.time_s(now_s))[channel])

    def convert(self, now_s: float) -> None:
        """The ADC converts the first channel."""
        if not self._scans.convert(now_s):
            return
        if self._start_s is None:
            self._start_s = now_s + self._scans.until_sample_s()
        if self._scans.is_sample:
            self.taken.append(Conversion(now_s, self.count(now_s), self.sampled.truth(self.time_s(now_s))))

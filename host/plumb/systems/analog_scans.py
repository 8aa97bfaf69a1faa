"""Scans of the board's analog inputs as a plant on the pins sees them: which conversions belong to a sample.

The board scans its inputs at least once per millisecond, whatever its period; the last scan of a period is the sample,
the others only show whether an input is at a rail or stuck. A plant's noise belongs to its samples, so every scan in
between needs noise of the converter of its own: without it the input would stand still for a whole period.
"""

from __future__ import annotations

import random

from plumb.physics.sensors import ADC_COUNTS, ADC_NOISE_LSB, ADC_REFERENCE_V

SCAN_INTERVAL_US = 1000
"""Longest time between two scans."""
SAME_SCAN_S = 100e-6
"""Conversions of one scan, and scans of one oversampled sample, follow each other sooner than this."""
TOLERANCE_S = 3e-6


class AnalogScans:
    """Follows the conversions of the first channel. A scan that does not come one interval after the last one is the
    first of another run: the timer was started anew."""

    def __init__(self, period_us: int, seed: int) -> None:
        self.per_period = -(-period_us // SCAN_INTERVAL_US)
        self.interval_s = period_us * 1e-6 / self.per_period
        self._last_s: float | None = None
        self._scans = 0
        self._chance = random.Random(seed)

    def until_sample_s(self) -> float:
        """From this scan to the next one that is a sample, in s; 0: this one is."""
        return -self._scans % self.per_period * self.interval_s

    def convert(self, now_s: float) -> bool:
        """The first channel is converted now. True where a new scan begins."""
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
        """Of one conversion between two samples."""
        return 0.0 if self.is_sample else self._chance.gauss(0.0, ADC_NOISE_LSB * ADC_REFERENCE_V / ADC_COUNTS)

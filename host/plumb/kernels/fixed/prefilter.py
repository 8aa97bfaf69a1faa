"""Prefilter of a three-axis sensor in integers: missing samples, spikes, smoothing, calibration
(docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, wrap_i32

AXES = range(3)
NO_SAMPLE, GAP_MAX = -32768, 65535
FLAG_SATURATED, FLAG_SAMPLE, FLAG_SPIKE = 1, 4, 16


@dataclass(slots=True)
class Sensor:
    """State of a prefilter, and the calibrated value of its last sample.

    last, before: counts of the last two samples; gap: steps since the last sample; spikes: bit mask of the axes.
    """

    name: str
    stale: int
    last: list[int] = field(default_factory=lambda: [0, 0, 0])
    before: list[int] = field(default_factory=lambda: [0, 0, 0])
    spikes: int = 0
    gap: int = GAP_MAX
    value: list[int] = field(default_factory=lambda: [0, 0, 0])

    def apply_sample(self, raw: Sequence[int], p: Params) -> int:
        """Process the counts of one step; returns flags: saturated 1, sample 4, spike 16."""
        group = "gyro" if self.name == "gyro" else "angular"
        low, high = p[f"{group}.raw_min"], p[f"{group}.raw_max"]
        result = presence(low, high, raw)
        if result != FLAG_SAMPLE:
            self.gap = min(self.gap + 1, GAP_MAX)
            return result
        gain, offset = p[f"{group}.gain"], p[f"{group}.offset"]
        limit, smooth = p[f"{group}_filter.spike_counts"], p[f"{group}_filter.smooth_q16"]
        fresh, spikes = self.gap > self.stale, 0
        for i in AXES:
            line = 2 * self.last[i] - self.before[i]
            was_spike = (self.spikes >> i) & 1 != 0
            off = abs(raw[i] - line) > limit
            spike = off and not fresh and not was_spike
            self.before[i] = raw[i] if fresh or (was_spike and off) else self.last[i]
            self.last[i] = clamp(line, low, high) if spike else raw[i]
            spikes |= spike << i
            now = wrap_i32(self.last[i] * gain + offset)
            self.value[i] = now if fresh else wrap_i32(self.value[i] + (((now - self.value[i]) * smooth) >> 16))
        self.spikes = spikes
        self.gap = 0
        return FLAG_SAMPLE | FLAG_SPIKE if spikes else FLAG_SAMPLE


def presence(low: int, high: int, raw: Sequence[int]) -> int:
    """Sample 4; saturated 1 with a count outside low..high; 0 when a count is missing."""
    if NO_SAMPLE in raw:
        return 0
    return FLAG_SAMPLE if all(low <= count <= high for count in raw) else FLAG_SATURATED

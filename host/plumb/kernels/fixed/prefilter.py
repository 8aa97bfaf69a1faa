"""Prefilter of a three-axis sensor in integers: missing samples, spikes, smoothing, calibration
(docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, select, wrap_i32

AXES = range(3)
NO_SAMPLE, GAP_MAX = -32768, 65535
FLAG_SATURATED, FLAG_SAMPLE, FLAG_SPIKE = 1, 4, 16


@dataclass(slots=True)
class Sensor:
    """State of a prefilter, and the calibrated value of its last sample.

    last, before: counts of the last two samples; gap: steps since the last sample; spikes: bit mask of the axes.
    """

    name: str
    stale: Integer
    last: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    before: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    spikes: Integer = 0
    gap: Integer = GAP_MAX
    value: list[Integer] = field(default_factory=lambda: [0, 0, 0])

    def apply_sample(self, raw: Sequence[Integer], p: Params) -> Integer:
        """Process the counts of one step; returns flags: saturated 1, sample 4, spike 16."""
        group = "gyro" if self.name == "gyro" else "angular"
        low, high = p[f"{group}.raw_min"], p[f"{group}.raw_max"]
        gain, offset = p[f"{group}.gain"], p[f"{group}.offset"]
        limit, smooth = p[f"{group}_filter.spike_counts"], p[f"{group}_filter.smooth_q16"]
        missing = (raw[0] == NO_SAMPLE) | (raw[1] == NO_SAMPLE) | (raw[2] == NO_SAMPLE)
        inside = (clamp(raw[0], low, high) == raw[0]) & (clamp(raw[1], low, high) == raw[1])
        inside = inside & (clamp(raw[2], low, high) == raw[2])
        sample = (missing == 0) & inside
        fresh, spikes = self.gap > self.stale, 0
        for i in AXES:
            line = 2 * self.last[i] - self.before[i]
            was_spike = ((self.spikes >> i) & 1) != 0
            off = abs(raw[i] - line) > limit
            spike = (fresh == 0) & (was_spike == 0) & off
            before = select(fresh | (was_spike & off), raw[i], self.last[i])
            last = select(spike, clamp(line, low, high), raw[i])
            now = wrap_i32(last * gain + offset)
            value = select(fresh, now, self.value[i] + (((now - self.value[i]) * smooth) >> 16))
            self.before[i], self.last[i] = select(sample, before, self.before[i]), select(sample, last, self.last[i])
            self.value[i] = select(sample, value, self.value[i])
            spikes = spikes | (select(spike, 1, 0) << i)
        self.spikes = select(sample, spikes, self.spikes)
        self.gap = select(sample, 0, clamp(self.gap + 1, 0, GAP_MAX))
        flags = select(spikes != 0, FLAG_SAMPLE | FLAG_SPIKE, FLAG_SAMPLE)
        return select(sample, flags, select(missing, 0, FLAG_SATURATED))

"""`toy` in integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, wrap_i32

GAIN, HEADING_LOW, HEADING_HIGH, TRIM, HOLD, MODE = range(9, 15)
"""Places of the commands among the inputs."""


@dataclass(slots=True)
class ToyState:
    filtered_counts_q16: int = 0
    clamped_steps: int = 0
    step: int = 0


def control_init(p: Params) -> ToyState:
    return ToyState()


def control_valid(p: Params) -> bool:
    """Every word is within its range."""
    return bool(p["toy.dt_s_q32"] >= 1 and 0 <= p["toy.raw_max"] <= 32767 and 1 <= p["toy.share_q16"] <= 65536)


def control_step(c: ToyState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    used = clamp(raw[0], 0, p["toy.raw_max"])
    apart = 0 if raw[HOLD] else (used << 16) - c.filtered_counts_q16
    c.filtered_counts_q16 += apart * p["toy.share_q16"] >> 16
    wheels = 0
    if raw[MODE]:
        wheels = sum(raw[1:5]) if raw[MODE] == 1 else sum(raw[1:9])
    total = raw[GAIN] * wheels
    heading = wrap_i32((raw[HEADING_HIGH] << 16) + (raw[HEADING_LOW] & 0xFFFF) + (raw[TRIM] << 16))
    clamped = int(used != raw[0])
    c.clamped_steps += clamped
    error = wrap_i32(setpoint - c.filtered_counts_q16)
    return (*raw, setpoint, c.filtered_counts_q16, error, total, heading, c.clamped_steps, clamped, c.step)

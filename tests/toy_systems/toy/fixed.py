"""`toy` in integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, select, wrap_i32


@dataclass(slots=True)
class ControlState:
    filtered_counts_q16: Integer = 0
    clamped_steps: Integer = 0
    step: int = 0


def control_init(p: Params) -> ControlState:
    return ControlState()


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint: Integer) -> tuple[Integer, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    used = clamp(raw[0], 0, p["toy.raw_max"])
    c.filtered_counts_q16 = c.filtered_counts_q16 + (((used << 16) - c.filtered_counts_q16) * p["toy.share_q16"] >> 16)
    clamped = select(used != raw[0], 1, 0)
    c.clamped_steps = c.clamped_steps + clamped
    error = wrap_i32(setpoint - c.filtered_counts_q16)
    return (*raw, setpoint, c.filtered_counts_q16, error, c.clamped_steps, clamped, c.step)

"""`current` in integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp

COUNT_MAX, ASKED_MAX, FLOWING_A, WHOLE_Q30 = 4095, 64 << 20, 1 << 17, 1 << 30
OVER_STEPS, OVER_LIMIT = 3, 1000


@dataclass(slots=True)
class CurrentState:
    integral_q30: int = 0
    over_steps: int = 0
    step: int = 0


def control_init(p: Params) -> CurrentState:
    return CurrentState()


def control_valid(p: Params) -> bool:
    """Every word that a product is made of is within its range."""
    ranges = {
        "gain_a_q20": (-65536, 65536),
        "zero_counts": (0, COUNT_MAX),
        "kp_q15": (0, 1 << 20),
        "ki_q30": (0, WHOLE_Q30),
        "duty_max_q15": (0, 32767),
    }
    return all(low <= p[f"current.{name}"] <= high for name, (low, high) in ranges.items())


def control_step(c: CurrentState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    used, most = clamp(raw[0], 0, COUNT_MAX), p["current.duty_max_q15"]
    current = (used - p["current.zero_counts"]) * p["current.gain_a_q20"]
    error = clamp(setpoint, -ASKED_MAX, ASKED_MAX) - current
    risen = clamp(p["current.ki_q30"] * error >> 20, -WHOLE_Q30, WHOLE_Q30)
    c.integral_q30 = clamp(c.integral_q30 + risen, 1 - WHOLE_Q30, WHOLE_Q30 - 1)
    duty = clamp((p["current.kp_q15"] * error >> 20) + (c.integral_q30 >> 15), -most, most)
    c.over_steps = min(c.over_steps + 1, OVER_LIMIT) if abs(current) > p["current.trip_a_q20"] else 0
    flags = 1 if used in (0, COUNT_MAX) else 0
    flags |= (2 if c.over_steps >= OVER_STEPS else 0) | (4 if abs(current) > FLOWING_A else 0)
    return (*raw, setpoint, current, error, c.integral_q30, duty, c.over_steps, flags, c.step)

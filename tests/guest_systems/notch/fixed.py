"""`notch` in integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp

COUNT_MAX, WHOLE_Q30, OUT_MAX = 4095, 1 << 30, 1 << 26


@dataclass(slots=True)
class NotchState:
    in_1: int = 0
    in_2: int = 0
    out_1: int = 0
    out_2: int = 0
    step: int = 0


def control_init(p: Params) -> NotchState:
    return NotchState()


def control_valid(p: Params) -> bool:
    return bool(0 <= p["notch.b0_q30"] <= WHOLE_Q30 and -WHOLE_Q30 < p["notch.a2_q30"] < WHOLE_Q30)


def control_step(c: NotchState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    count = clamp(raw[0], 0, COUNT_MAX)
    total = p["notch.b0_q30"] * ((count + c.in_2) << 12) + p["notch.b1_q30"] * ((c.in_1 << 12) - c.out_1)
    out = clamp((total - p["notch.a2_q30"] * c.out_2) >> 30, -OUT_MAX, OUT_MAX)
    c.in_2, c.in_1, c.out_2, c.out_1 = c.in_1, count, c.out_1, out
    flags = 1 if count in (0, COUNT_MAX) else 0
    return (*raw, setpoint, out, (count << 12) - out, flags, c.step)

"""`gantry` in integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, wrap_i32

FAR = 1 << 24
Y, Z_LOW, Z_HIGH = range(6, 9)
"""Places of the commands among the inputs."""


@dataclass(slots=True)
class GantryState:
    path: list[int] = field(default_factory=lambda: [0, 0, 0])
    step: int = 0


def control_init(p: Params) -> GantryState:
    return GantryState()


def control_valid(p: Params) -> bool:
    return bool(1 <= p["gantry.step_counts"] <= 32767)


def control_step(c: GantryState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step: the values of its words, in the written order."""
    c.step += 1
    asked = (setpoint, raw[Y], wrap_i32((raw[Z_HIGH] << 16) + (raw[Z_LOW] & 0xFFFF)))
    most = p["gantry.step_counts"]
    c.path = [
        path + clamp(clamp(place, -FAR, FAR) - path, -most, most) for path, place in zip(c.path, asked, strict=True)
    ]
    apart = [path - raw[i] for i, path in enumerate(c.path)]
    flags = 1 if asked == tuple(c.path) else 0
    return (*raw, setpoint, *c.path, *apart, flags, c.step)

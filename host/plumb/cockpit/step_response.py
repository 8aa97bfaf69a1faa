"""Figures of a step response: what a step of the setpoint did to the controlled signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SETTLED = 0.05
"""Part of the step within which the signal counts as settled."""
LAST_PART = 0.2
"""The final value is the mean over this last part of the test."""
FEWEST = 10
"""Samples below which there are no figures."""


@dataclass(frozen=True)
class StepResponse:
    """rise_s: from 10 to 90 % of the step; settling_s: until it stays within 5 % of the step around its final value;
    overshoot_percent: beyond the final value; off: final value less the setpoint, in the unit of the signal. None: the
    signal never got there."""

    rise_s: float | None
    settling_s: float | None
    overshoot_percent: float
    off: float


def figures(
    time_s: Sequence[float], value: Sequence[float], begin_s: float, before: float, step: float
) -> StepResponse | None:
    """Figures of a step of the setpoint by `step` at begin_s, from a signal that was at `before`; None when there are
    too few samples. time_s, value: the signal from begin_s on."""
    times, moved = np.asarray(time_s, np.float64) - begin_s, (np.asarray(value, np.float64) - before) / step
    if len(times) < FEWEST:
        return None
    final = float(moved[-max(1, int(LAST_PART * len(moved))) :].mean())
    first, last = _crossing(times, moved, 0.1), _crossing(times, moved, 0.9)
    away = np.flatnonzero(np.abs(moved - final) > SETTLED)
    rise = last - first if first is not None and last is not None else None
    settled: float | None = None if rise is None else 0.0
    if rise is not None and len(away):
        settled = float(times[away[-1] + 1]) if away[-1] + 1 < len(times) else None
    overshoot = max(0.0, float(moved.max()) - final) * 100.0
    return StepResponse(rise, settled, overshoot, (final - 1.0) * step)


def _crossing(times: np.ndarray, moved: np.ndarray, level: float) -> float | None:
    """The first time at which the signal reaches the level."""
    reached = np.flatnonzero(moved >= level)
    return float(times[reached[0]]) if len(reached) else None

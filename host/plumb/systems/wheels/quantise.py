"""Quantise the tuning of `wheels`, and back."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.systems.balancer import quantise as balancer
from plumb.systems.wheels.settings import Riding, Turning, Watching
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.systems.wheels.vehicle import G_MPS2
from plumb.tuning.declared import setting_words, settings_of
from plumb.tuning.groups import check_numbers, refuse, whole

COUNT_MAX, FELT_MAX = 1 << 30, 1 << 30
TURN = 360.0
RATE_MAX = 4 << 28
"""Largest turn rate that the wheels may show, turn/s Q28."""


def quantise(tuning: WheelsTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    balanced = balancer.quantise(replace(tuning.balance, period_us=tuning.period_us, exact_period_s=None))
    dt = tuning.period_us * 1e-6
    felt = {"wheels.felt_mps_q26": min(round(math.tau * G_MPS2 * dt * 2**26), FELT_MAX)}
    own = {**balanced.own(), **_counts(tuning.turning, dt), **felt, **setting_words(tuning)}
    return ControlParams.of("wheels", own, balanced.context)


def _counts(turning: Turning, dt: float) -> dict[str, int]:
    """The turn rate of a count, a count of the turn rate, and the most counts."""
    if not turning.track_m:
        refuse("turning.track_m", turning.track_m, "wheels are apart")
    per_count = turning.count_m / dt / turning.track_m / math.tau * 2**28
    count = whole("turning.count_m", turning.count_m, Fraction(per_count), -COUNT_MAX, COUNT_MAX)
    shown = turning.wheels_max_dps / TURN * 2**28
    most = min(int(shown / abs(count)), (1 << 15) - 1) if count else (1 << 15) - 1
    if most < 1 or shown > RATE_MAX:
        refuse("turning.wheels_max_dps", turning.wheels_max_dps, "a count or more, and at most 1440 deg/s", 0.0, 1440.0)
    return {
        "wheels.count_turnps_q28": count,
        "wheels.counts_max": most,
        "wheels.turn_counts_q36": max(min(round(2**36 / count), COUNT_MAX), -COUNT_MAX) if count else 0,
    }


def dequantise(params: ControlParams) -> WheelsTuning:
    """The tuning that the integers represent."""
    p, dt = params.values, params.period_s
    balance = balancer.dequantise(params)
    # An encoder's count is that of one wheel; balance counts both. The track is what the two ways of a count leave.
    count_m = 2.0 * balance.wheel.edge_m
    per_count = p["wheels.count_turnps_q28"] / 2**28 * math.tau
    own = {
        "turning.count_m": count_m,
        "turning.track_m": count_m / dt / per_count if per_count else math.inf,
        "turning.wheels_max_dps": p["wheels.counts_max"] * abs(p["wheels.count_turnps_q28"]) / 2**28 * TURN,
    }
    return WheelsTuning(
        period_us=balance.period_us,
        balance=balance,
        turning=settings_of(Turning, params, "turning", own=own),
        riding=settings_of(Riding, params, "riding"),
        watching=settings_of(Watching, params, "watching"),
        exact_period_s=balance.exact_period_s,
    )

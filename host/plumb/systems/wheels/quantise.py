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
from plumb.tuning.whole import check_numbers, refuse, whole

COUNT_MAX = 1 << 30
RATE_MAX_DPS = 1440.0
"""Largest turn rate that the wheels may show."""


def quantise(tuning: WheelsTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    balanced = balancer.quantise(replace(tuning.balance, period_us=tuning.period_us, exact_period_s=None))
    check_numbers(tuning)
    dt = Fraction(int(tuning.period_us), 10**6)
    felt = {"wheels.felt_mps_q26": round(Fraction(math.tau) * Fraction(G_MPS2) * dt * 2**26)}
    own = {**balanced.own(), **_counts(tuning.turning, dt), **felt, **setting_words(tuning)}
    return ControlParams.of("wheels", own, balanced.context)


def _counts(turning: Turning, dt: Fraction) -> dict[str, int]:
    """The turn rate of a count, a count of the turn rate, and the most counts."""
    if not turning.track_m:
        refuse("turning.track_m", turning.track_m, "wheels are apart")
    per_count = Fraction(turning.count_m) / dt / Fraction(turning.track_m) / Fraction(math.tau) * 2**28
    count = whole("turning.count_m", turning.count_m, per_count, -COUNT_MAX, COUNT_MAX)
    shown, least_dps = Fraction(turning.wheels_max_dps) * 2**28 / 360, abs(count) * 360 / 2**28
    if shown < abs(count) or turning.wheels_max_dps > RATE_MAX_DPS:
        reason = f"a count, {least_dps:.6g} deg/s, or more, and at most {RATE_MAX_DPS:g} deg/s"
        refuse("turning.wheels_max_dps", turning.wheels_max_dps, reason, least_dps, RATE_MAX_DPS)
    return {
        "wheels.count_turnps_q28": count,
        "wheels.counts_max": min(int(shown / abs(count)), (1 << 15) - 1) if count else (1 << 15) - 1,
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
        "turning.wheels_max_dps": p["wheels.counts_max"] * abs(p["wheels.count_turnps_q28"]) / 2**28 * 360.0,
    }
    return WheelsTuning(
        period_us=balance.period_us,
        balance=balance,
        turning=settings_of(Turning, params, "turning", own=own),
        riding=settings_of(Riding, params, "riding"),
        watching=settings_of(Watching, params, "watching"),
        exact_period_s=balance.exact_period_s,
    )

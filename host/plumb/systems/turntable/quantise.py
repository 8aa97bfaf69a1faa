"""Quantise the tuning of `turntable`, and back."""

from __future__ import annotations

import math
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.errors import SettingError
from plumb.spec.tuning import Channel
from plumb.systems.turntable.settings import Fusion, Prefilter
from plumb.systems.turntable.tuning import TurntableTuning
from plumb.tuning.declared import setting_words, settings_of
from plumb.tuning.groups import channel_of, channel_words
from plumb.tuning.whole import check_numbers, not_negative, refuse, whole

WORD = (1 << 32) - 1
MOST = (1 << 31) - 1
TURN = Fraction(1 << 28, 360)
NO_SPIKE_COUNTS = 1 << 17


def quantise(tuning: TurntableTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    if not 500 <= tuning.period_us <= 10_000:
        refuse("period_us", tuning.period_us, "the turntable's steps take 500 to 10000 us", 500, 10_000)
    own = {
        **channel_words("gyro", tuning.gyro, TURN),
        **channel_words("angular", tuning.angular, TURN),
        **_spike("gyro_filter", tuning.gyro_filter, tuning.gyro),
        **_spike("angular_filter", tuning.angular_filter, tuning.angular),
        **_fusion(tuning),
    }
    return ControlParams.of("turntable", own)


def _spike(name: str, asked: Prefilter, channel: Channel) -> dict[str, int]:
    if asked.spike <= 0:
        refuse(f"{name}.spike", asked.spike, "give more than 0", 0.0, math.inf)
    if channel.unit_per_count == 0:
        zero = f"{name.removesuffix('_filter')}.unit_per_count"
        refuse(zero, 0.0, "a count must stand for something", -math.inf, math.inf)
    return {f"{name}.spike_counts": min(max(round(asked.spike / abs(channel.unit_per_count)), 1), NO_SPIKE_COUNTS)}


def _fusion(tuning: TurntableTuning) -> dict[str, int]:
    """The words of both smoothing filters and of the fusion."""
    f, dt = tuning.fusion, Fraction(int(tuning.period_us), 10**6)
    not_negative(
        {f"fusion.{name}": float(getattr(f, name)) for name in ("gyro_phase_s", "gyro_scale", "angular_scale")}
    )
    period = Fraction(f.gyro_period_s).limit_denominator(10**7) / dt
    if not 1 <= period <= 16:
        reason = "a gyro sample comes every 1 to 16 steps"
        refuse("fusion.gyro_period_s", f.gyro_period_s, reason, float(dt), float(16 * dt))
    declared = setting_words(tuning, {"period": period, "four_dt": 4 * dt})
    period_q24, lag = round(period * (1 << 24)), Fraction(f.lag_s) / dt
    age = (-1 - Fraction(f.gyro_phase_s) / dt) % period
    scale = Fraction(f.gyro_scale) ** 2 + Fraction(f.angular_scale) ** 2
    share = Fraction(f.gyro_scale) ** 2 / scale if scale else Fraction(1, 2)
    alpha = Fraction(-math.expm1(-1.0 / float(lag))) if lag else Fraction(1)
    return {
        **declared,
        "fusion.dt_s_q32": round(dt * (1 << 32)),
        "fusion.step_hz_q16": round((1 << 16) / dt),
        "fusion.gyro_period_step_q24": period_q24,
        "fusion.gyro_age_step_q24": min(round(age * (1 << 24)), period_q24 - 1),
        "fusion.gyro_samples_step_q30": round((1 << 30) / period),
        "fusion.lag_alpha_q31": min(round(alpha * (1 << 31)), MOST),
        "fusion.share_q30": round(share * (1 << 30)),
        "fusion.v_scale_q40": _scale(f),
    }


def _scale(f: Fusion) -> int:
    """gyro_scale^2 + angular_scale^2, Q40."""
    rest, unit = Fraction(f.angular_scale) ** 2, 1 << 40
    if rest * unit > WORD:
        most = math.sqrt(WORD / unit)
        refuse("fusion.angular_scale", f.angular_scale, f"too large, the most is {most:.6g}", 0.0, most)
    word = (Fraction(f.gyro_scale) ** 2 + rest) * unit
    try:
        return whole("fusion.gyro_scale", f.gyro_scale, word, 0, WORD)
    except SettingError:
        least, most = (math.sqrt(max(Fraction(limit, unit) - rest, Fraction(0))) for limit in (500, WORD))
        reason = f"with angular_scale = {f.angular_scale:g} it may be {least:.3g} to {most:.6g}"
        refuse("fusion.gyro_scale", f.gyro_scale, reason, 0.0 if word > WORD else least, most)


def dequantise(params: ControlParams) -> TurntableTuning:
    """The tuning that the integers represent."""
    p, dt = params.values, params.period_s
    gyro, angular = (channel_of(params, name, 2**28 / 360) for name in ("gyro", "angular"))
    period = p["fusion.gyro_period_step_q24"] / 2**24
    share, scale = p["fusion.share_q30"] / 2**30, p["fusion.v_scale_q40"] / 2.0**40
    names = {"period": period, "four_dt": 4 * dt}
    own = {
        "gyro_filter.spike": p["gyro_filter.spike_counts"] * abs(gyro.unit_per_count),
        "angular_filter.spike": p["angular_filter.spike_counts"] * abs(angular.unit_per_count),
        "fusion.gyro_period_s": period * dt,
        "fusion.gyro_phase_s": (-1 - p["fusion.gyro_age_step_q24"] / 2**24) % period * dt,
        "fusion.gyro_scale": math.sqrt(share * scale),
        "fusion.angular_scale": math.sqrt((1 - share) * scale),
    }
    return TurntableTuning(
        period_us=round(dt * 1e6),
        gyro=gyro,
        angular=angular,
        gyro_filter=settings_of(Prefilter, params, "gyro_filter", own=own),
        angular_filter=settings_of(Prefilter, params, "angular_filter", own=own),
        fusion=settings_of(Fusion, params, "fusion", names, own),
        exact_period_s=dt,
    )

"""Quantise the tuning of `turntable`, and back."""

from __future__ import annotations

import math
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.errors import SettingError, UsageError
from plumb.spec.tuning import Channel
from plumb.systems.turntable.tuning import Fusion, Prefilter, TurntableTuning
from plumb.tuning.groups import DEG2, channel_of, channel_words
from plumb.tuning.whole import check_numbers, not_negative, refuse, whole

LAYERS = ("data", "attitude", "printed")
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
        **_prefilter("gyro_filter", tuning.gyro_filter, tuning.gyro),
        **_prefilter("angular_filter", tuning.angular_filter, tuning.angular),
        **_fusion(tuning.fusion, Fraction(int(tuning.period_us), 10**6)),
    }
    return ControlParams.of("turntable", own)


def _prefilter(name: str, asked: Prefilter, channel: Channel) -> dict[str, int]:
    if asked.spike <= 0:
        refuse(f"{name}.spike", asked.spike, "give more than 0", 0.0, math.inf)
    if not 0 < asked.smooth <= 1:
        refuse(f"{name}.smooth", asked.smooth, "give more than 0, up to 1", 0.0, 1.0)
    if channel.unit_per_count == 0:
        refuse(
            f"{name.removesuffix('_filter')}.unit_per_count",
            0.0,
            "a count must stand for something",
            -math.inf,
            math.inf,
        )
    counts = min(max(round(asked.spike / abs(channel.unit_per_count)), 1), NO_SPIKE_COUNTS)
    smooth = whole(f"{name}.smooth", asked.smooth, Fraction(asked.smooth) * (1 << 16), 1, 1 << 16)
    return {f"{name}.spike_counts": counts, f"{name}.smooth_q16": smooth}


def _fusion(f: Fusion, dt: Fraction) -> dict[str, int]:
    if f.layer not in LAYERS:
        raise UsageError(f"fusion.layer = '{f.layer}': {', '.join(LAYERS)}")
    names = ("rest_s", "lag_s", "gyro_phase_s", "gyro_scale", "angular_scale", "start_lag_s")
    not_negative({f"fusion.{name}": float(getattr(f, name)) for name in names})
    period = Fraction(f.gyro_period_s).limit_denominator(10**7) / dt
    if not 1 <= period <= 16:
        refuse(
            "fusion.gyro_period_s",
            f.gyro_period_s,
            "a gyro sample comes every 1 to 16 steps",
            float(dt),
            float(16 * dt),
        )
    rest_steps = round(Fraction(f.rest_s) / dt)
    if rest_steps > WORD:
        refuse(
            "fusion.rest_s",
            f.rest_s,
            f"too long for its integer, the most is {float(WORD * dt):.6g}",
            0.0,
            float(WORD * dt),
        )
    lag = Fraction(f.lag_s) / dt
    if lag > 16:
        refuse("fusion.lag_s", f.lag_s, "at most 16 steps", 0.0, float(16 * dt))
    if Fraction(f.start_lag_s) / dt > 1:
        refuse("fusion.start_lag_s", f.start_lag_s, "a lag is uncertain by at most one step", 0.0, float(dt))
    period_q24 = round(period * (1 << 24))
    age = (-1 - Fraction(f.gyro_phase_s) / dt) % period
    scale = Fraction(f.gyro_scale) ** 2 + Fraction(f.angular_scale) ** 2
    share = Fraction(f.gyro_scale) ** 2 / scale if scale else Fraction(1, 2)
    alpha = Fraction(-math.expm1(-1.0 / float(lag))) if lag else Fraction(1)

    def square(name: str, factor: Fraction, bits: int, high: int = WORD, low: int = 0) -> int:
        """(the field * DEG)^2 * factor in Q bits."""
        asked = float(getattr(f, name))
        not_negative({f"fusion.{name}": asked})
        return whole(f"fusion.{name}", asked, Fraction(asked) ** 2 * factor * (1 << bits), low, high, power=2)

    four = (4 * dt) ** 2
    return {
        "fusion.layer": LAYERS.index(f.layer),
        "fusion.dt_s_q32": round(dt * (1 << 32)),
        "fusion.step_hz_q16": round((1 << 16) / dt),
        "fusion.gyro_period_step_q24": period_q24,
        "fusion.gyro_age_step_q24": min(round(age * (1 << 24)), period_q24 - 1),
        "fusion.gyro_samples_step_q30": round((1 << 30) / period),
        "fusion.rest_steps": rest_steps,
        "fusion.lag_step_q24": whole("fusion.lag_s", f.lag_s, lag * (1 << 24), 0, 1 << 28),
        "fusion.lag_alpha_q31": min(round(alpha * (1 << 31)), MOST),
        "fusion.share_q30": round(share * (1 << 30)),
        "fusion.r_gyro_q44": square("gyro_dps", DEG2 / (period * dt), 44, low=1 << 12),
        "fusion.q_rate_q52": square("angular_dps2", DEG2 * dt, 52),
        "fusion.q_rate_lost_q44": square("lost_dps2", DEG2 * dt, 44),
        "fusion.q_gyro_bias_q60": square("gyro_walk_dps", DEG2 * dt, 60),
        "fusion.q_angular_bias_q64": square("angular_walk_dps2", DEG2 * dt * four, 64),
        "fusion.p_gyro_bias_q40": square("start_gyro_dps", DEG2, 40),
        "fusion.p_angular_bias_q52": square("start_angular_dps2", DEG2 * four, 52),
        "fusion.v_scale_q40": _scale(f),
        "fusion.v_lag_q30": square("start_lag_s", 1 / dt**2, 30, 1 << 30),
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

    def root(name: str, bits: int, per: float = 1.0 / 360**2) -> float:
        """The inverse of `square`."""
        return math.sqrt(p[f"fusion.{name}"] / 2.0**bits / per)

    share, scale = p["fusion.share_q30"] / 2**30, p["fusion.v_scale_q40"] / 2.0**40
    deg2 = 1.0 / 360**2
    fusion = Fusion(
        layer=LAYERS[p["fusion.layer"]],  # type: ignore[arg-type]
        gyro_period_s=period * dt,
        gyro_phase_s=(-1 - p["fusion.gyro_age_step_q24"] / 2**24) % period * dt,
        rest_s=p["fusion.rest_steps"] * dt,
        lag_s=p["fusion.lag_step_q24"] / 2**24 * dt,
        gyro_dps=root("r_gyro_q44", 44, deg2 / (period * dt)),
        angular_dps2=root("q_rate_q52", 52, deg2 * dt),
        lost_dps2=root("q_rate_lost_q44", 44, deg2 * dt),
        gyro_walk_dps=root("q_gyro_bias_q60", 60, deg2 * dt),
        angular_walk_dps2=root("q_angular_bias_q64", 64, deg2 * dt * (4 * dt) ** 2),
        start_gyro_dps=root("p_gyro_bias_q40", 40),
        start_angular_dps2=root("p_angular_bias_q52", 52, deg2 * (4 * dt) ** 2),
        gyro_scale=math.sqrt(share * scale),
        angular_scale=math.sqrt((1 - share) * scale),
        start_lag_s=root("v_lag_q30", 30, 1.0) * dt,
    )
    return TurntableTuning(
        period_us=round(dt * 1e6),
        gyro=gyro,
        angular=angular,
        gyro_filter=_prefilter_of(params, "gyro_filter", gyro),
        angular_filter=_prefilter_of(params, "angular_filter", angular),
        fusion=fusion,
        exact_period_s=dt,
    )


def _prefilter_of(params: ControlParams, name: str, channel: Channel) -> Prefilter:
    spike = params[f"{name}.spike_counts"] * abs(channel.unit_per_count)
    return Prefilter(spike, params[f"{name}.smooth_q16"] / 2**16)

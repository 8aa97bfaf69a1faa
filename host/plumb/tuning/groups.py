"""Quantise the parameter groups that systems share: engineering units to integers, and back.

The computation uses exact fractions. Each integer is within 0.1 % of the setting, or the setting is refused with a
reason. The one free choice is the unit of variance, the "lsb" of the filter: as fine as the largest variance of the set
allows, and, for a small R, such that R is a whole number of 2^32 lsb.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import TypedDict, get_args

from plumb.contract.parameters import ControlParams
from plumb.errors import SettingError, UsageError
from plumb.spec.speed_controllers import ONE_WAY, foreign_parameter
from plumb.spec.tuning import (
    AxisTuning,
    Calibration,
    Channel,
    Esc,
    Kalman,
    Pid,
    RateChoice,
    Start,
    TiltMode,
    Trust,
)
from plumb.tuning.declared import SHARED, group_words, setting_word, settings_of, shared_settings
from plumb.tuning.variances import lsb_of
from plumb.tuning.whole import TOLERANCE, check_numbers, not_negative, refuse, whole

CALIBRATION_LIMIT = 7 << 28
VARIANCE_MAX = 1 << 56
"""Largest qa, p11 and |p01| in lsb; the limit of p00 is twice as high."""
R_MAX = 1 << 24
"""Largest R, in 2^32 lsb."""
BIAS_MAX = ((1 << 26) - 1) << 32
"""Largest initial bias per step, turn Q61."""
QB_MAX = (1 << 62) - 1
"""Largest process noise of the bias, in 2^-30 lsb."""
DEG2 = Fraction(1, 360**2)
"""Square degrees in turn^2."""
HALF = {"half": Fraction(1, 2)}
"""Pulses are in half-microseconds."""
RATES: tuple[RateChoice, ...] = get_args(RateChoice)
"""Each at the place that is its integer."""


def channel_words(name: str, channel: Channel, unit: Fraction) -> dict[str, int]:
    """The words of a calibration group. unit: integer units (turn/s Q28 or g Q26) per engineering unit."""
    low, high = channel.min_counts, channel.max_counts
    if not -32768 <= high <= 32767 or high != int(high):
        refuse(f"{name}.max_counts", high, "whole counts of 16 bits", -32768, 32767)
    if not -32768 <= low <= high or low != int(low):
        refuse(f"{name}.min_counts", low, f"whole counts of 16 bits, up to max_counts = {high}", -32768, high)
    per_count, zero = Fraction(channel.unit_per_count) * unit, Fraction(channel.zero_counts)
    limit = (1 << 31) - 1
    gain = whole(f"{name}.unit_per_count", channel.unit_per_count, per_count, -limit, limit)
    offset = round(-zero * gain)
    worst = max(abs(low * gain + offset), abs(high * gain + offset))
    if worst > CALIBRATION_LIMIT:
        most, asked = float(CALIBRATION_LIMIT / unit), float(worst / unit)
        reach = CALIBRATION_LIMIT / float(unit) / max(abs(low - float(zero)), abs(high - float(zero)))
        reason = f"reaches {asked:.6g} at its counts, most {most:.6g}"
        refuse(f"{name}.unit_per_count", channel.unit_per_count, reason, -reach, reach)
    offset = whole(f"{name}.zero_counts", channel.zero_counts, -zero * gain, -(1 << 31), limit)
    return {f"{name}.raw_min": int(low), f"{name}.raw_max": int(high), f"{name}.gain": gain, f"{name}.offset": offset}


def _variances(
    kalman: Kalman, start: Start, trust: Trust, r_max_deg2: float, dt: Fraction
) -> dict[str, tuple[float, Fraction]]:
    """Name -> (setting, the same in turn^2, with the bias per step)."""
    q, p = kalman, start
    asked = {
        "trust.r_deg2": (trust.r_deg2, Fraction(1)),
        "trust.r_max_deg2": (r_max_deg2, Fraction(1)),
        "kalman.q_angle_deg2_per_s": (q.q_angle_deg2_per_s, dt),
        "kalman.q_bias_dps2_per_s": (q.q_bias_dps2_per_s, dt**3),
        "start.p00_deg2": (p.p00_deg2, Fraction(1)),
        "start.p01_deg2_per_s": (p.p01_deg2_per_s, dt),
        "start.p11_dps2": (p.p11_dps2, dt**2),
    }
    return {name: (value, Fraction(value) * per * DEG2) for name, (value, per) in asked.items()}


LIMITS = {
    "trust.r_max_deg2": R_MAX << 32,
    "kalman.q_angle_deg2_per_s": VARIANCE_MAX,
    "kalman.q_bias_dps2_per_s": 1 << 32,
    "start.p00_deg2": 2 * VARIANCE_MAX,
    "start.p01_deg2_per_s": VARIANCE_MAX,
    "start.p11_dps2": VARIANCE_MAX,
}
"""Largest value in lsb of each variance."""


def _units(variances: dict[str, tuple[float, Fraction]]) -> Iterator[Fraction]:
    """Units of variance to try, turn^2 per lsb, the finest first. A small R is a whole number of 2^32 lsb in each."""
    finest, name = max((abs(variances[name][1]) / limit, name) for name, limit in LIMITS.items())
    asked, r = variances["trust.r_deg2"]
    r_most = r / finest / (1 << 32)
    if r_most * (1 + TOLERANCE / 2) < 1:
        least = asked / float(r_most)
        reason = f"too small beside {name} = {variances[name][0]:g}, the least is {least:.3g}"
        refuse("trust.r_deg2", asked, reason, least, math.inf)
    if r_most > 2 / TOLERANCE:
        yield finest
    for multiple in range(min(math.floor(r_most * (1 + TOLERANCE / 2)), 4000), 0, -1):
        yield r / Fraction(multiple << 32)


def check_filter(kalman: Kalman, start: Start, trust: Trust, period_us: int) -> None:
    """Raises UsageError for filter settings that are invalid or contradict each other."""
    if kalman.rate not in RATES:
        raise UsageError(f"kalman.rate = '{kalman.rate}': {', '.join(RATES[:-1])} or {RATES[-1]}")
    not_negative(
        {
            "kalman.q_angle_deg2_per_s": kalman.q_angle_deg2_per_s,
            "kalman.q_bias_dps2_per_s": kalman.q_bias_dps2_per_s,
            "kalman.bias_max_dps": kalman.bias_max_dps,
            "start.p00_deg2": start.p00_deg2,
            "start.p11_dps2": start.p11_dps2,
            "trust.gain_deg2": trust.gain_deg2,
        }
    )
    if trust.r_deg2 <= 0:
        refuse("trust.r_deg2", trust.r_deg2, "a measurement has some variance, give more than 0", 0.0, math.inf)
    if trust.gain_deg2 and trust.r_max_deg2 < trust.r_deg2:
        refuse("trust.r_max_deg2", trust.r_max_deg2, f"less than r_deg2 = {trust.r_deg2:g}", trust.r_deg2, math.inf)
    p01, reach = start.p01_deg2_per_s, start.p00_deg2 / (period_us * 1e-6)
    lowest = min(reach, math.sqrt(start.p00_deg2) * math.sqrt(start.p11_dps2))
    highest = min(lowest, kalman.q_angle_deg2_per_s / 4)
    if Fraction(p01) ** 2 > Fraction(start.p00_deg2) * Fraction(start.p11_dps2):
        reason = "its square is more than p00 times p11, no covariance"
        refuse("start.p01_deg2_per_s", p01, reason, -lowest, highest)
    if not -reach <= p01 <= min(reach, kalman.q_angle_deg2_per_s / 4):
        reason = f"outside -p00 / period to {min(reach, kalman.q_angle_deg2_per_s / 4):g} (Q_angle / 4)"
        refuse("start.p01_deg2_per_s", p01, reason, -lowest, highest)
    if (most := kalman.bias_max_dps) >= 360:
        refuse("kalman.bias_max_dps", most, "the published bias stays below 360 deg/s", 0.0, 360.0)
    if abs(start.bias_dps) > most:
        refuse("start.bias_dps", start.bias_dps, f"more than kalman.bias_max_dps = {most:g}", -most, most)


def filter_words(
    kalman: Kalman,
    start: Start,
    trust: Trust,
    period_us: int,
    *,
    r_left_out_deg2: float | None = None,
    unit_deg2: Fraction | None = None,
) -> tuple[dict[str, int], Fraction]:
    """The words of the groups kalman and start and the variances of tilt; and the unit of variance in deg^2 per lsb.

    r_left_out_deg2: the value of r_max if R is constant, for systems that use r_max in place of a skipped measurement.
    unit_deg2: the unit to use; None for the finest one in which all variances fit.
    """
    dt = Fraction(int(period_us), 10**6)
    r_max_deg2 = trust.r_max_deg2 if trust.gain_deg2 else r_left_out_deg2 or trust.r_deg2
    variances = _variances(kalman, start, trust, r_max_deg2, dt)
    reason: SettingError | None = None
    for unit in _units(variances) if unit_deg2 is None else [unit_deg2 * DEG2]:
        try:
            words = _in_unit(trust, variances, unit)
            break
        except SettingError as error:
            reason = reason or error
    else:
        largest = max(LIMITS, key=lambda name: abs(variances[name][1]) / LIMITS[name])
        assert reason is not None
        raise reason.saying(f"{reason}, or for less of {largest} = {variances[largest][0]:g}, which sets the unit")
    half_turn = 1 << 31
    rate_shift = math.floor(1 / dt).bit_length()

    def bias(name: str, asked: float, bits: int, low: int, high: int) -> int:
        return whole(name, asked, Fraction(asked) / 360 * dt * (1 << bits), low, high)

    tilt = whole("start.tilt_deg", start.tilt_deg, Fraction(start.tilt_deg) / 360 * (1 << 32), -half_turn, half_turn)
    words |= {
        "kalman.dt_s_q33": round(dt * (1 << 33)),
        "kalman.rate_now": RATES.index(kalman.rate),
        "kalman.bias_max_turn_q29": bias("kalman.bias_max_dps", kalman.bias_max_dps, 29, 0, half_turn - 1),
        "kalman.rate_gain": min(round(Fraction(2) ** (31 - rate_shift) / dt), half_turn - 1),
        "kalman.rate_shift": rate_shift,
        **_split("start.bias", bias("start.bias_dps", start.bias_dps, 61, -BIAS_MAX, BIAS_MAX)),
        "start.tilt_turn_q32": (tilt + half_turn) % (1 << 32) - half_turn,
    }
    return words, unit / DEG2


def _in_unit(trust: Trust, variances: dict[str, tuple[float, Fraction]], unit: Fraction) -> dict[str, int]:
    def lsb(name: str, low: int, high: int, fraction_bits: int = 0) -> int:
        asked, exact = variances[name]
        return whole(name, asked, exact / unit * Fraction(2) ** fraction_bits, low, high)

    r_base, r_max = lsb("trust.r_deg2", 1, R_MAX, -32), lsb("trust.r_max_deg2", 1, R_MAX, -32)
    qa, qb = lsb("kalman.q_angle_deg2_per_s", 0, VARIANCE_MAX), lsb("kalman.q_bias_dps2_per_s", 0, QB_MAX, 30)
    p00, p11 = lsb("start.p00_deg2", 0, 2 * VARIANCE_MAX), lsb("start.p11_dps2", 0, VARIANCE_MAX - 1)
    p01 = lsb("start.p01_deg2_per_s", -VARIANCE_MAX, VARIANCE_MAX)
    return {
        "tilt.r_base": r_base,
        **_gain(trust, unit, r_base, r_max),
        **_split("kalman.qa", qa),
        "kalman.qb": qb >> 30,
        "kalman.qb_frac_q30": qb & ((1 << 30) - 1),
        **_split("start.p00", p00),
        **_split("start.p01", p01),
        **_split("start.p11", p11),
    }


def _split(name: str, value: int) -> dict[str, int]:
    return {f"{name}_hi": value >> 32, f"{name}_lo": value & 0xFFFFFFFF}


def _gain(trust: Trust, unit: Fraction, r_base: int, r_max: int) -> dict[str, int]:
    """The words that compute R from the deviation d = | |a|^2 - 1 |, g^2 Q20. d is clamped just above the value at
    which R reaches its limit, and shifted left as far as 32 bits and the resolution of r_gain allow."""
    none = {"tilt.r_gain": 0, "tilt.r_max": r_max, "tilt.deviation_max": 0, "tilt.deviation_shift": 0}
    if not trust.gain_deg2:
        return none
    gain = Fraction(trust.gain_deg2) * DEG2 / (unit * (1 << 32))
    d_max = min(math.isqrt(math.ceil((r_max - r_base) / gain * (1 << 40))) + 2, (1 << 31) - 1)
    for shift in range(min(31, 32 - d_max.bit_length()), -1, -1):
        exact = gain * Fraction(2) ** (24 - 2 * shift)
        if exact > 2 / TOLERANCE or shift == 0:
            r_gain = whole("trust.gain_deg2", trust.gain_deg2, exact, 0, (1 << 32) - 1)
            return {**none, "tilt.r_gain": r_gain, "tilt.deviation_max": d_max, "tilt.deviation_shift": shift}
    raise AssertionError("a shift of zero always returns")


def pid_words(pid: Pid, period_us: int) -> dict[str, int]:
    """The words of the group pid."""
    return group_words("pid", pid, {"dt": Fraction(int(period_us), 10**6)})


def axis_words(tuning: AxisTuning) -> tuple[dict[str, int], Fraction]:
    """The words that one-axis systems share (three channels, tilt, filter, controller), and the unit of variance in
    deg^2."""
    check_numbers(tuning)
    if tuning.tilt not in ("arcsine", "atan2"):
        raise UsageError(f"tilt = '{tuning.tilt}': arcsine or atan2")
    check_filter(tuning.kalman, tuning.start, tuning.trust, tuning.period_us)
    filtered, lsb_deg2 = filter_words(tuning.kalman, tuning.start, tuning.trust, tuning.period_us)
    words = {
        **channel_words("gyro", tuning.calibration.gyro, Fraction(1 << 28, 360)),
        **channel_words("accel", tuning.calibration.accel, Fraction(1 << 26)),
        **channel_words("accel_up", tuning.calibration.accel_up, Fraction(1 << 26)),
        "tilt.mode": int(tuning.tilt == "atan2"),
        **filtered,
        **pid_words(tuning.pid, tuning.period_us),
    }
    return words, lsb_deg2


def esc_words(esc: Esc) -> dict[str, int]:
    """The words of the group esc."""
    words: dict[str, int] = {}
    lows: dict[str, float] = {}
    for row, setting in shared_settings("esc"):
        asked, (low, high) = float(getattr(esc, setting.name.removeprefix("esc."))), setting.limits(row.min, row.max)
        if not low <= 2 * asked <= high:
            foreign = foreign_parameter(row.name, round(2 * asked)) or ONE_WAY
            refuse(setting.name, asked, f"outside {low / 2:g} to {high / 2:g} us; {foreign}", low / 2, high / 2)
        words[row.name] = setting_word(row, setting, asked, HALF)
        lows[setting.name] = row.min / 2
    for less, more in (("neutral_us", "min_us"), ("min_us", "mid_us"), ("mid_us", "max_us")):
        if getattr(esc, less) > getattr(esc, more):
            least, most = lows[f"esc.{less}"], getattr(esc, more)
            refuse(f"esc.{less}", getattr(esc, less), f"more than {more} = {most:g}", least, most)
    return words


def channel_of(params: ControlParams, name: str, per_unit: float) -> Channel:
    """The calibration of a channel in engineering units. per_unit: integer units per engineering unit."""
    gain, offset = params[f"{name}.gain"], params[f"{name}.offset"]
    zero = -offset / gain if gain else 0.0
    return Channel(zero, gain / per_unit, params[f"{name}.raw_min"], params[f"{name}.raw_max"])


def filter_of(params: ControlParams) -> tuple[Kalman, Start, Trust]:
    """The filter's settings in engineering units, using the set's unit of variance."""
    p, dt, lsb = params.values, params.period_s, lsb_of(params)
    r_lsb, shift = lsb * 2**32, p["tilt.deviation_shift"]
    gain = p["tilt.r_gain"] * r_lsb * 2.0 ** (2 * shift - 24)
    reached = p["tilt.r_base"] * r_lsb + gain * (p["tilt.deviation_max"] / 2**20) ** 2
    kalman = Kalman(
        q_angle_deg2_per_s=params.wide("kalman.qa_hi", "kalman.qa_lo") * lsb / dt,
        q_bias_dps2_per_s=(p["kalman.qb"] + p["kalman.qb_frac_q30"] / 2**30) * lsb / dt**3,
        rate=RATES[p["kalman.rate_now"]],
        bias_max_dps=p["kalman.bias_max_turn_q29"] / 2**29 * 360 / dt,
    )
    start = Start(
        tilt_deg=p["start.tilt_turn_q32"] / 2**32 * 360,
        bias_dps=params.wide("start.bias_hi", "start.bias_lo") / 2**61 * 360 / dt,
        p00_deg2=params.wide("start.p00_hi", "start.p00_lo") * lsb,
        p01_deg2_per_s=params.wide("start.p01_hi", "start.p01_lo") * lsb / dt,
        p11_dps2=params.wide("start.p11_hi", "start.p11_lo") * lsb / dt**2,
    )
    return kalman, start, Trust(p["tilt.r_base"] * r_lsb, gain, min(p["tilt.r_max"] * r_lsb, reached))


def pid_of(params: ControlParams) -> Pid:
    """The controller's settings in engineering units."""
    return settings_of(Pid, params, "pid", system=SHARED)


class AxisFields(TypedDict):
    """The fields of an AxisTuning, by name."""

    period_us: int
    exact_period_s: float
    calibration: Calibration
    tilt: TiltMode
    trust: Trust
    kalman: Kalman
    start: Start
    pid: Pid


def axis_of(params: ControlParams) -> AxisFields:
    """The settings behind the words of `axis_words`, as fields of a tuning by name."""
    kalman, start, trust = filter_of(params)
    return {
        "period_us": round(params.period_s * 1e6),
        "exact_period_s": params.period_s,
        "calibration": Calibration(
            channel_of(params, "gyro", 2**28 / 360),
            channel_of(params, "accel", 2**26),
            channel_of(params, "accel_up", 2**26),
        ),
        "tilt": "atan2" if params["tilt.mode"] else "arcsine",
        "trust": trust,
        "kalman": kalman,
        "start": start,
        "pid": pid_of(params),
    }


def esc_of(params: ControlParams) -> Esc:
    """The settings of the pulses in us."""
    return settings_of(Esc, params, "esc", HALF, system=SHARED)

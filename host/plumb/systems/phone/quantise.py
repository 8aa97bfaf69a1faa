"""Quantise the tuning of `phone`, and back. Both filters use the same unit of variance."""

from __future__ import annotations

import math
from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.spec.tuning import Trust
from plumb.systems.phone.tuning import PhoneAxis, PhoneTuning
from plumb.tuning.groups import channel_of, channel_words, check_filter, filter_of, filter_words
from plumb.tuning.variances import in_variances, lsb_of
from plumb.tuning.whole import check_numbers, refuse


def quantise(tuning: PhoneTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    if tuning.rates not in ("body", "euler"):
        raise UsageError(f"rates = '{tuning.rates}': body or euler")
    try:
        pitch, roll, unit_deg2 = _both(tuning)
    except UsageError as reason:
        try:
            pitch, roll, unit_deg2 = _both(tuning, finest="roll")
        except UsageError:
            raise reason from None
    own = {
        **channel_words("gyro", tuning.gyro, Fraction(1 << 28, 360)),
        **channel_words("accel", tuning.accel, Fraction(1 << 26)),
        "tilt.mode": 1,
        **pitch,
        "phone.rates": int(tuning.rates == "euler"),
        **{f"roll.{name}": roll[f"tilt.{name}"] for name in ("r_base", "r_max")},
        **{f"roll.{name}": roll[f"kalman.{name}"] for name in ("qa_hi", "qa_lo", "qb", "qb_frac_q30")},
        **{f"roll.{name}": value for name, value in roll.items() if name.startswith("start.")},
    }
    return ControlParams.of("phone", own, in_variances(float(unit_deg2)))


def _both(tuning: PhoneTuning, finest: str = "pitch") -> tuple[dict[str, int], dict[str, int], Fraction]:
    """The words of pitch and of roll in the finest unit of variance of `finest`; raises UsageError if the other does
    not fit it."""
    words: dict[str, dict[str, int]] = {}
    unit_deg2: Fraction | None = None
    for name in ("pitch", "roll") if finest == "pitch" else ("roll", "pitch"):
        axis: PhoneAxis = getattr(tuning, name)
        kalman, trust = tuning.kalman(axis), Trust(axis.r_deg2)
        if tuning.r_left_out_deg2 < axis.r_deg2:
            refuse(
                "r_left_out_deg2",
                tuning.r_left_out_deg2,
                f"less than {name}.r_deg2 = {axis.r_deg2:g}",
                axis.r_deg2,
                math.inf,
            )
        try:
            check_filter(kalman, axis.start, trust, tuning.period_us)
            words[name], unit_deg2 = filter_words(
                kalman, axis.start, trust, tuning.period_us, r_left_out_deg2=tuning.r_left_out_deg2, unit_deg2=unit_deg2
            )
        except UsageError as error:
            raise error.saying(f"{name}: {error}") from None
    assert unit_deg2 is not None
    return words["pitch"], words["roll"], unit_deg2


def dequantise(params: ControlParams) -> PhoneTuning:
    """The tuning that the integers represent."""
    own = {name.removeprefix("roll."): value for name, value in params.values.items() if name.startswith("roll.start.")}
    own |= {f"kalman.{name}": params[f"roll.{name}"] for name in ("qa_hi", "qa_lo", "qb", "qb_frac_q30")}
    own |= {f"tilt.{name}": params[f"roll.{name}"] for name in ("r_base", "r_max")}
    kalman, start, trust = filter_of(params)
    roll_kalman, roll_start, roll_trust = filter_of(ControlParams({**params.values, **own}, params.context))
    return PhoneTuning(
        period_us=round(params.period_s * 1e6),
        gyro=channel_of(params, "gyro", 2**28 / 360),
        accel=channel_of(params, "accel", 2**26),
        pitch=PhoneAxis(kalman.q_angle_deg2_per_s, kalman.q_bias_dps2_per_s, trust.r_deg2, start),
        roll=PhoneAxis(roll_kalman.q_angle_deg2_per_s, roll_kalman.q_bias_dps2_per_s, roll_trust.r_deg2, roll_start),
        rates="euler" if params["phone.rates"] else "body",
        r_left_out_deg2=params["tilt.r_max"] * lsb_of(params) * 2.0**32,
        rate=kalman.rate,
        bias_max_dps=kalman.bias_max_dps,
        exact_period_s=params.period_s,
    )

"""`quad`: its tuning as integers, and back."""

from __future__ import annotations

from fractions import Fraction

from plumb.errors import UsageError
from plumb.quantise import ControlParams
from plumb.quantise.groups import (
    channel_of,
    channel_words,
    check_filter,
    check_numbers,
    esc_of,
    esc_words,
    filter_of,
    filter_words,
    pid_of,
    pid_words,
)
from plumb.tuning import Calibration, Tuning

GROUPS = ("gyro", "accel_y", "accel_z", "tilt", "kalman", "start", "pid", "esc")


def quantise(tuning: Tuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    check_numbers(tuning)
    if tuning.tilt not in ("arcsine", "atan2"):
        raise UsageError(f"tilt = '{tuning.tilt}': arcsine or atan2")
    check_filter(tuning.kalman, tuning.start, tuning.trust, tuning.period_us)
    filtered, lsb_deg2 = filter_words(tuning.kalman, tuning.start, tuning.trust, tuning.period_us)
    own = {
        **channel_words("gyro", tuning.calibration.gyro, Fraction(1 << 28, 360)),
        **channel_words("accel_y", tuning.calibration.accel_y, Fraction(1 << 26)),
        **channel_words("accel_z", tuning.calibration.accel_z, Fraction(1 << 26)),
        "tilt.mode": int(tuning.tilt == "atan2"),
        **filtered,
        **pid_words(tuning.pid, tuning.period_us),
        **esc_words(tuning.esc),
    }
    return ControlParams.of("quad", own, float(lsb_deg2))


def dequantise(params: ControlParams) -> Tuning:
    """What the integers mean."""
    kalman, start, trust = filter_of(params)
    return Tuning(
        period_us=round(params.period_s * 1e6),
        calibration=Calibration(
            channel_of(params, "gyro", 2**28 / 360),
            channel_of(params, "accel_y", 2**26),
            channel_of(params, "accel_z", 2**26),
        ),
        tilt="atan2" if params["tilt.mode"] else "arcsine",
        trust=trust,
        kalman=kalman,
        start=start,
        pid=pid_of(params),
        esc=esc_of(params),
        exact_period_s=params.period_s,
    )

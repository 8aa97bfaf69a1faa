"""Recognise settings for speed controllers that plumb does not support.

plumb drives one-way PWM controllers only: pulses of 900 to 2100 us, neutral (motor off) at the lower end, frames of
2040 to 20000 us. firmware/core/esc.h has the same bounds, and the board clamps every pulse to them.
"""

from __future__ import annotations

PULSE_US = (900.0, 2100.0)
NEUTRAL_MAX_US = 1050.0
"""Of an armed board: ESC_OFF_MAX_HALFUS."""
TWO_WAY_US = (1400.0, 1600.0)
"""Neutral pulses of two-way controllers: 1500 us, and what they take for it."""
FRAME_MIN_US = 2040.0
FRAME_MAX_US = 20_000.0
GAP_HALFUS = 40
"""ESC_GAP_MIN_HALFUS: shortest low time between two pulses."""
ONE_WAY = "plumb drives one-way PWM controllers alone (pulses of 900 to 2100 us, neutral 900 to 1050 us)"
_SHORT_PULSES = (
    (30.0, "Multishot (5 to 25 us)"),
    (100.0, "OneShot42 (42 to 84 us)"),
    (300.0, "OneShot125 (125 to 250 us)"),
)
"""Longest pulse, and the kind of controller that takes pulses up to it."""


def foreign_pulse(pulse_us: float) -> str:
    """A sentence that names the kind of controller a too short pulse is for; "" if the kind is unknown."""
    for most_us, kind in _SHORT_PULSES:
        if 0 < pulse_us <= most_us:
            return f"{pulse_us:g} us is a pulse of {kind}; {ONE_WAY}"
    return ""


def foreign_neutral(neutral_us: float) -> str:
    """A sentence about a neutral pulse that may turn a motor, is that of two-way controllers, or is too short; "" if it
    is none of these."""
    if NEUTRAL_MAX_US < neutral_us < TWO_WAY_US[0]:
        return f"a neutral pulse of {neutral_us:g} us may already turn a motor; {ONE_WAY}"
    if TWO_WAY_US[0] <= neutral_us <= PULSE_US[1]:
        return f"a neutral pulse of {neutral_us:g} us is that of a two-way (3D) controller; {ONE_WAY}"
    return foreign_pulse(neutral_us)


def foreign_frame(frame_us: float) -> str:
    """A sentence that names the controllers for a frame too short for plumb; "" if the frame is long enough."""
    if frame_us >= FRAME_MIN_US:
        return ""
    return f"frames of {frame_us:g} us are for OneShot125, OneShot42, Multishot or DShot controllers; {ONE_WAY}"


def foreign_parameter(name: str, value: int) -> str:
    """A sentence that names the kind of controller an out-of-range parameter is probably for; "" if none is known."""
    if name == "esc.neutral_halfus":
        return foreign_neutral(value / 2)
    if name == "esc_period_us":
        return foreign_frame(value)
    if name in ("esc.min_halfus", "esc.mid_halfus", "esc.max_halfus"):
        return foreign_pulse(value / 2)
    return ""

"""`notch`: its tuning as integers, and back."""

from __future__ import annotations

import math

from plumb.systems.notch.tuning import NotchTuning

from plumb.contract.parameters import ControlParams


def quantise(tuning: NotchTuning) -> ControlParams:
    b0, b1, a2 = (round(value * 2**30) for value in tuning.coefficients())
    period = round(tuning.period_us * 1e-6 * 2**32)
    own = {"dt_s_q32": period, "b0_q30": b0, "b1_q30": b1, "a2_q30": a2}
    return ControlParams.of("notch", {f"notch.{name}": value for name, value in own.items()})


def dequantise(params: ControlParams) -> NotchTuning:
    b0, b1 = params["notch.b0_q30"] / 2**30, params["notch.b1_q30"] / 2**30
    turn = math.acos(-b1 / (2.0 * b0))
    centre_hz = turn / (2.0 * math.pi * params.period_s)
    width_hz = (1.0 / b0 - 1.0) * 2.0 * centre_hz / math.sin(turn)
    return NotchTuning(round(params.period_s * 1e6), centre_hz, width_hz)

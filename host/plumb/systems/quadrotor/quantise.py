"""Quantise the tuning of `quadrotor`, and back."""

from __future__ import annotations

import math
from dataclasses import replace

from plumb.contract.parameters import ControlParams
from plumb.systems.attitude import quantise as attitude
from plumb.systems.quadrotor.settings import Level, Mixer, Rates, Receiver, Stops
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.tuning.declared import setting_words, settings_of
from plumb.tuning.groups import esc_of, esc_words

GROUPS = ("gyro", "accel", "gyro_mounting", "accel_mounting", "attitude")
"""Groups of parameters that are those of attitude."""


def quantise(tuning: QuadrotorTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    estimator = attitude.quantise(replace(tuning.attitude, period_us=tuning.period_us, exact_period_s=None)).values
    own = {
        **{name: value for name, value in estimator.items() if name.split(".")[0] in GROUPS},
        **setting_words(tuning, {"alpha": _alpha(tuning.rates.d_tau_s, tuning.period_us * 1e-6)}),
        **esc_words(tuning.esc),  # last: its numbers are finite then
    }
    return ControlParams.of("quadrotor", own)


def _alpha(tau_s: float, dt: float) -> float:
    """The derivative acts on the rate less its low-pass of the step before: dt / alpha times the filtered slope."""
    return -math.expm1(-dt / tau_s) if tau_s > 0 else 1.0


def dequantise(params: ControlParams) -> QuadrotorTuning:
    """The tuning that the integers represent."""
    names = {"alpha": params["quadrotor.d_alpha_q31"] / 2**31}
    estimator = attitude.dequantise(params)
    return QuadrotorTuning(
        period_us=estimator.period_us,
        attitude=estimator,
        rates=settings_of(Rates, params, "rates", names),
        level=settings_of(Level, params, "level"),
        mixer=settings_of(Mixer, params, "mixer"),
        receiver=settings_of(Receiver, params, "receiver"),
        stops=settings_of(Stops, params, "stops"),
        esc=esc_of(params),
        exact_period_s=estimator.exact_period_s,
    )

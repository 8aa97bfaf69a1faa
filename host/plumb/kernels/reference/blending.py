"""Complementary filter and weighted average, the simple alternatives to the Kalman filter that the sources name.

They are here to be compared with, in float64; the firmware has neither. Units: deg, deg/s, s. Each takes floats or
arrays of runs.
"""

from __future__ import annotations

from plumb.kernels.reference.kernels import Number, wrap


def complementary_step(angle_deg: Number, rate_dps: Number, z_deg: Number, period_s: float, tau_s: float) -> Number:
    """The gyro through a high-pass and the measured angle through a low-pass of the same time constant:

        angle(k) = a (angle(k-1) + Ts rate) + (1 - a) z(k)      a = tau / (tau + Ts)

    It estimates no bias: a bias of b deg/s leaves an error of b tau. The difference is an angle and wraps at +-180 deg.
    """
    predicted_deg = angle_deg + period_s * rate_dps
    return wrap(predicted_deg + period_s / (tau_s + period_s) * wrap(z_deg - predicted_deg))


def weighted_average(gyro_deg: Number, z_deg: Number, weight: float) -> Number:
    """weight times the integrated gyro plus (1 - weight) times the measured angle, the short way around. Nothing
    corrects the integral, so its drift remains in the result, times the weight."""
    return wrap(z_deg + weight * wrap(gyro_deg - z_deg))

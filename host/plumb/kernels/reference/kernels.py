"""The kernels that systems share in float64: the equations as the papers print them.

Units: deg, deg/s, g, s. Equation numbers (1) to (5) are those of the filter that systems of one axis share:

    x = [phi, b]^T        tilt and gyro bias
    A = [[1, -Ts], [0, 1]]    B = [Ts, 0]^T    H = [1, 0]
    (1) X(k|k-1) = A X(k-1|k-1) + B U(k)
    (2) P(k|k-1) = A P(k-1|k-1) A^T + Q
    (3) X(k|k)   = X(k|k-1) + K (Z - H X(k|k-1))
    (4) K        = P(k|k-1) H^T (H P(k|k-1) H^T + R)^-1
    (5) P(k|k)   = (I - K H) P(k|k-1)

The 2x2 products are written out and all four entries of P are kept. Every kernel takes floats or arrays of runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plumb.spec.tuning import Channel, Kalman, Pid, RateChoice, Start, TiltMode, Trust

Number = Any  # Any: the operators of the two kinds have no common type
"""A float, or an array with one float per run."""


def clip(x: Number, low: Number, high: Number) -> Number:
    """x within [low, high]. For the short arrays of a batch of runs np.clip takes four times as long."""
    return min(max(x, low), high) if isinstance(x, float) else np.minimum(np.maximum(x, low), high)


def atan2(y: Number, x: Number) -> Number:
    """Angle in degrees of the point (x, y), -180 to 180."""
    return np.degrees(np.arctan2(y, x))


def asin(sine: Number) -> Number:
    """Angle in degrees, -90 to 90; a sine beyond +-1 counts as +-1."""
    return np.degrees(np.arcsin(clip(sine, -1.0, 1.0)))


def wrap(angle_deg: Number) -> Number:
    """The same angle in -180 <= angle < 180."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def calibrate(raw: Number, channel: Channel) -> Number:
    """Counts to the channel's unit."""
    return (clip(raw, channel.min_counts, channel.max_counts) - channel.zero_counts) * channel.unit_per_count


def tilt(accel_y_g: Number, accel_z_g: Number, mode: TiltMode) -> Number:
    """Tilt in degrees from the acceleration: arcsin(a / g) as in the paper, or from both axes."""
    return asin(accel_y_g) if mode == "arcsine" else atan2(accel_y_g, accel_z_g)


def trust(accel_y_g: Number, accel_z_g: Number, settings: Trust) -> Number:
    """Variance R in deg^2: grows with the square of |a|^2 - 1 g^2, up to its limit."""
    if settings.gain_deg2 == 0:
        return settings.r_deg2 + 0.0 * accel_y_g
    excess = accel_y_g * accel_y_g + accel_z_g * accel_z_g - 1.0
    return np.minimum(settings.r_deg2 + settings.gain_deg2 * excess * excess, settings.r_max_deg2)


@dataclass
class KalmanState:
    """X and P of equations (1) to (5), and the gyro sample that is U of the next step; the first step uses its own
    sample."""

    tilt_deg: Number
    bias_dps: Number
    p00: Number
    p01: Number
    p10: Number
    p11: Number
    rate_dps: Number = None
    innovation_deg: Number = 0.0
    k0: Number = 0.0
    k1: Number = 0.0


def kalman_init(start: Start) -> KalmanState:
    """X0 and P0."""
    return KalmanState(
        start.tilt_deg, start.bias_dps, start.p00_deg2, start.p01_deg2_per_s, start.p01_deg2_per_s, start.p11_dps2
    )


def driving_rate(choice: RateChoice, rate_dps: Number, before_dps: Number) -> Number:
    """U(k) from the present and the previous sample of the gyro."""
    if choice == "trapezium":
        return 0.5 * (before_dps + rate_dps)
    return rate_dps if choice == "current" else before_dps


def kalman_step(
    x: KalmanState, settings: Kalman, period_s: float, z_deg: Number, rate_dps: Number, r_deg2: Number
) -> None:
    """One predict and update; z is the accelerometer's tilt, rate the gyro's current sample."""
    ts = period_s
    before_dps = rate_dps if x.rate_dps is None else x.rate_dps
    u = driving_rate(settings.rate, rate_dps, before_dps)
    x.rate_dps = rate_dps

    # (1) X(k|k-1) = A X(k-1|k-1) + B U(k)
    tilt_deg = x.tilt_deg - ts * x.bias_dps + ts * u
    bias_dps = x.bias_dps

    # (2) P(k|k-1) = A P(k-1|k-1) A^T + Q
    p00 = x.p00 - ts * x.p10 - ts * (x.p01 - ts * x.p11) + settings.q_angle_deg2_per_s * ts
    p01 = x.p01 - ts * x.p11
    p10 = x.p10 - ts * x.p11
    p11 = x.p11 + settings.q_bias_dps2_per_s * ts

    # (4) K = P(k|k-1) H^T (H P(k|k-1) H^T + R)^-1
    s = p00 + r_deg2
    k0 = p00 / s
    k1 = p10 / s

    # (3) X(k|k) = X(k|k-1) + K (Z - H X(k|k-1)); the innovation is an angle and wraps
    innovation = wrap(z_deg - tilt_deg)
    x.tilt_deg = wrap(tilt_deg + k0 * innovation)
    x.bias_dps = bias_dps + k1 * innovation

    # (5) P(k|k) = (I - K H) P(k|k-1)
    x.p00 = (1.0 - k0) * p00
    x.p01 = (1.0 - k0) * p01
    x.p10 = p10 - k1 * p00
    x.p11 = p11 - k1 * p01

    x.innovation_deg, x.k0, x.k1 = innovation, k0, k1


@dataclass
class PidState:
    """Integral and command in [-1, 1], filtered rate in deg/s."""

    integral: Number = 0.0
    rate_filtered_dps: Number = 0.0
    command: Number = 0.0


def pid_step(c: PidState, settings: Pid, period_s: float, error_deg: Number, rate_dps: Number) -> None:
    """One step: command from the tilt error and the measured rate, with anti-windup."""
    tau = settings.derivative_tau_s
    c.rate_filtered_dps += (rate_dps - c.rate_filtered_dps) * (1.0 - math.exp(-period_s / tau) if tau else 1.0)
    demand = settings.kp_per_deg * error_deg + c.integral - settings.kd_per_dps * c.rate_filtered_dps

    slew = settings.slew_per_s * period_s
    c.command = clip(clip(demand, -1.0, 1.0), c.command - slew, c.command + slew)

    growth = settings.ki_per_deg_s * period_s * error_deg
    further = (demand - c.command) * growth > 0.0
    c.integral += growth * (1.0 - further)

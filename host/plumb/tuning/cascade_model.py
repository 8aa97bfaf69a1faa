"""A cascade of vertical and rate as a frequency response: for loops whose error of the vertical asks for a rate.

    asked  = level (wanted tilt - tilt)
    demand = kp (asked - rate) + ki integral of (asked - rate) - kd slope of the filtered rate

The tilt is the sum of the rates: above some tenths of a hertz an attitude filter follows its gyro alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.tuning.loop_model import Response


@dataclass(frozen=True)
class CascadeGains:
    """Of one axis: command by deg/s, deg and deg/s^2. level_per_s: rate by the error of the vertical; mode rate: 0."""

    kp_per_dps: float
    ki_per_deg: float
    kd_per_dps2: float
    level_per_s: float


@dataclass(frozen=True)
class Cascade:
    """The controller of one axis. d_tau_s: low-pass of the rate in the D term; 0: none."""

    period_s: float
    d_tau_s: float

    def estimate(self, hz: FloatArray, rate: Response, tilt: Response) -> tuple[Response, Response]:
        """Tilt and rate as the controller has them, of these samples."""
        back = np.exp(-2j * math.pi * hz * self.period_s)
        return np.asarray(rate * self.period_s * (1.0 + back) / (2.0 * (1.0 - back))), rate

    def command(self, hz: FloatArray, tilt: Response, rate: Response, gains: CascadeGains) -> Response:
        """Minus the command that it makes of them while it is asked for tilt 0."""
        ts = self.period_s
        back = np.exp(-2j * math.pi * hz * ts)
        alpha = 1.0 - math.exp(-ts / self.d_tau_s) if self.d_tau_s else 1.0
        filtered = rate * alpha / (1.0 - (1.0 - alpha) * back)
        error = rate + gains.level_per_s * tilt
        straight = (gains.kp_per_dps + gains.ki_per_deg * ts / (1.0 - back)) * error
        return np.asarray(straight + gains.kd_per_dps2 * filtered * (1.0 - back) / ts)

"""The cascade of `quadrotor` in float64: from the vertical to rates, to commands of the axes, to rotors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor.settings import Mixer, RateGains, Rates
from plumb.systems.quadrotor.tuning import QuadrotorTuning

ROLLS_OVER = 1.0 / 64.0
"""One plus the cosine of 170 deg: nearer to upside down the error has no axis, and the body rolls."""
ERROR_MAX = 2.0
KEPT_ON_GROUND = 31.0 / 32.0
"""Share of an integral that a step on the ground leaves."""
AXES = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, -1, 1, -1]], float)
"""What commands of roll, pitch and yaw add to each rotor: front right, front left, rear left, rear right."""


def error_of_vertical(lean: tuple[float, float], up: FloatArray) -> FloatArray:
    """The turn that brings the vertical where it is wanted, in body axes (3,): the sine of the angle, beyond a right
    angle the tangent of half of it. lean: sines of the wanted leans about x and y."""
    x, y = -lean[1], lean[0]
    s = x * x + y * y
    wanted = np.array([x, y, 1.0 - s / 2.0 - s**2 / 8.0 - s**3 / 16.0])  # the root of 1 - s, to its third power
    (wx, wy, wz), (ux, uy, uz) = wanted.tolist(), up.tolist()
    error = np.array([wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux])
    n = 1.0 + float(wanted @ up)
    if n < ROLLS_OVER:
        return np.array([ERROR_MAX, 0.0, 0.0])
    return np.clip(error / n, -ERROR_MAX, ERROR_MAX) if n < 1.0 else error


def asked_rates(
    tuning: QuadrotorTuning, sticks: tuple[float, float, float], levels: bool, up: FloatArray, rate_max_dps: float
) -> FloatArray:
    """Rates that are asked for, deg/s in body axes (3,). rate_max_dps: most that the error of the vertical asks for."""
    rates, level = tuning.rates, tuning.level
    roll, pitch, yaw = sticks
    yaw_dps = yaw * rates.yaw_max_dps
    if not levels:
        return np.array([roll * rates.roll_pitch_max_dps, pitch * rates.roll_pitch_max_dps, yaw_dps])
    sine = math.sin(math.radians(level.lean_max_deg))
    error = error_of_vertical((roll * sine, pitch * sine), up)
    upright = np.clip(np.degrees(level.gain_per_s * error), -rate_max_dps, rate_max_dps)
    return np.asarray(upright + yaw_dps * up)


@dataclass
class RateLoop:
    """One axis. excess: what the mixer left of the demand in the step before."""

    gains: RateGains
    rate_filtered_dps: float = 0.0
    integral: float = 0.0
    excess: float = 0.0
    demand: float = 0.0

    def step(
        self, rates: Rates, period_s: float, asked_dps: float, rate_dps: float, *, flies: bool, landed: bool,
        touches: bool = False,
    ) -> float:  # fmt: skip
        """The command that the axis asks for."""
        error_dps = asked_dps - rate_dps
        alpha = 1.0 - math.exp(-period_s / rates.d_tau_s) if rates.d_tau_s else 1.0
        change_dps = alpha * (rate_dps - self.rate_filtered_dps)
        self.rate_filtered_dps += change_dps
        if not flies:
            self.integral = 0.0
        elif landed:
            self.integral *= KEPT_ON_GROUND
        elif not touches and self.excess * error_dps <= 0.0:
            grown = self.integral + self.gains.ki_per_deg * period_s * error_dps
            self.integral = min(max(grown, -rates.integral_max), rates.integral_max)
        direct = self.gains.kp_per_dps * error_dps + self.gains.ff_per_dps * asked_dps
        self.demand = direct - self.gains.kd_per_dps2 * change_dps / period_s + self.integral
        return self.demand


@dataclass(frozen=True)
class Mixed:
    """Commands of the rotors (4,), 0 to 1, their mean, what roll, pitch and yaw got (3,); limited: roll and pitch asked
    for more."""

    rotors: FloatArray
    thrust: float
    got: FloatArray
    limited: bool


def mix(settings: Mixer, throttle: float, demand: FloatArray, *, may_fly: bool) -> Mixed:
    """Roll and pitch come first, together; yaw gets what they leave; the thrust gives way to all three."""
    idle, free = settings.idle, bool(settings.airmode) and may_fly
    half = (1.0 - idle) / 2.0
    if not free:
        half = min(max(throttle - idle, 0.0), half)
    tilt = np.clip(demand[:2], -1.0, 1.0)
    total = float(np.abs(tilt).sum())
    if total > half:
        tilt = tilt * (half / total)
    left = half - float(np.abs(tilt).max() if free else np.abs(tilt).sum())
    most = min(max(left, 0.0), settings.yaw_max)
    got = np.array([*tilt, min(max(float(demand[2]), -most), most)])
    added = got @ AXES
    thrust = min(max(throttle, idle - float(added.min())), 1.0 - float(added.max()))
    return Mixed(np.clip(thrust + added, idle, 1.0), thrust, got, total > half)

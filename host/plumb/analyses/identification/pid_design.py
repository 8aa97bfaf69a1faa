"""Gains of the PID for a plant: the best rejection of disturbances that the wanted margins allow.

A torque on the body tilts it by |tilt / command| |1 / (1 + loop)| for each unit of command that it equals. Torques of
gusts and of a load that hangs off centre are slow, so the mean square of that response over a logarithmic frequency
axis is what the gains minimise; the margins are held by a penalty that is steep beyond them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Pid
from plumb.tuning.loop_model import Loop, Margins

STEEP = 300.0
"""Cost of a margin that is missed by its own size."""
UNSTABLE = 1e6
LOWEST_REJECTED_HZ = 0.05
LONGEST_INTEGRAL_S = 3.0
"""A load that hangs off centre is gone after a few times this: the I term never fades away."""
ROUNDING = 0.01
SEARCHES = 2
TAU_STEPS = (0.1, 4.0)
"""Shortest and longest filter of the D term, in steps."""


@dataclass(frozen=True)
class Wanted:
    """Least margins: of the phase, of the gain upwards and downwards, and of further delay."""

    phase_deg: float = 35.0
    gain_db: float = 6.0
    delay_s: float = 0.0


@dataclass(frozen=True)
class Design:
    """Gains, what they reach, and whether all that was wanted is met. rejection_db: mean response to a disturbance
    against the gains before; below 0 is better."""

    pid: Pid
    margins: Margins
    met: bool
    rejection_db: float


def design(loop: Loop, before: Pid, wanted: Wanted) -> Design:
    """The gains; slew_per_s stays."""
    from scipy.optimize import minimize

    period_s = 0.499 / float(loop.hz[-1])
    slow = loop.hz >= LOWEST_REJECTED_HZ

    def pid_of(logs: FloatArray) -> Pid:
        kp, ki, kd, tau = (float(value) for value in np.exp(np.clip(logs, -30.0, 30.0)))
        ki = max(ki, kp / LONGEST_INTEGRAL_S)
        tau = min(max(tau, TAU_STEPS[0] * period_s), TAU_STEPS[1] * period_s)
        return replace(before, kp_per_deg=kp, ki_per_deg_s=ki, kd_per_dps=kd, derivative_tau_s=tau)

    def rejection(pid: Pid) -> float:
        """Mean square of the tilt that a unit of disturbance makes, in dB."""
        response = np.abs(loop.tilt / (1.0 + loop.gain(pid)))[slow]
        return 10.0 * math.log10(float(np.mean(response**2)))

    def cost(logs: FloatArray) -> float:
        pid = pid_of(logs)
        found = loop.margins(pid)
        if not math.isfinite(found.phase_deg):
            return UNSTABLE
        return rejection(pid) + STEEP * shortfall(found, wanted)

    starts = [_scaled(before, 1.0, 1.0), _scaled(before, 0.4, 0.15), _scaled(before, 0.2, 0.03)]
    best = np.zeros(4)
    least = math.inf
    for start in starts:
        logs = np.log([*start, max(before.derivative_tau_s, TAU_STEPS[0] * period_s)])
        for _ in range(SEARCHES):  # a simplex that has collapsed begins again where it stopped
            found = minimize(cost, logs, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3, "maxfev": 400})
            logs = found.x
        if float(found.fun) < least:
            best, least = logs, float(found.fun)
    pid = _rounded(pid_of(best))
    reached = loop.margins(pid)
    return Design(pid, reached, meets(reached, wanted), rejection(pid) - rejection(before))


def meets(found: Margins, wanted: Wanted) -> bool:
    """Whether the margins are reached, within the rounding of the gains."""
    return found.stable and shortfall(found, wanted) < ROUNDING


def shortfall(found: Margins, wanted: Wanted) -> float:
    """By how much the margins miss what is wanted, each as a share of it; 0 where all are met."""
    missed = max(0.0, 1.0 - found.phase_deg / wanted.phase_deg)
    missed += max(0.0, 1.0 - found.gain_db / wanted.gain_db) + max(0.0, 1.0 - found.lower_gain_db / wanted.gain_db)
    return missed + (max(0.0, 1.0 - found.delay_s / wanted.delay_s) if wanted.delay_s else 0.0)


def _scaled(pid: Pid, by: float, integral: float) -> list[float]:
    gains = (by * pid.kp_per_deg, integral * pid.ki_per_deg_s, math.sqrt(by) * pid.kd_per_dps)
    return [max(gain, 1e-6) for gain in gains]


def _rounded(pid: Pid) -> Pid:
    """As a person types them."""
    gains = (pid.kp_per_deg, pid.ki_per_deg_s, pid.kd_per_dps, pid.derivative_tau_s)
    kp, ki, kd, tau = (float(f"{gain:.3g}") for gain in gains)
    return replace(pid, kp_per_deg=kp, ki_per_deg_s=ki, kd_per_dps=kd, derivative_tau_s=tau)

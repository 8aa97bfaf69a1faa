"""Gains of the PID for a plant: the best rejection of disturbances that the wanted margins allow.

A torque on the body tilts it by |tilt / command| |1 / (1 + loop)| for each unit of command that it equals. Torques of
gusts and of a load that hangs off centre are slow, so the mean square of that response over a logarithmic frequency
axis is what the gains minimise; the margins are held by a penalty that is steep beyond them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Pid
from plumb.tuning.loop_model import Loop, Margins

G = TypeVar("G")
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
class Design(Generic[G]):
    """Gains, what they reach, and whether all that was wanted is met. rejection_db: mean response to a disturbance
    against the gains before; below 0 is better."""

    gains: G
    margins: Margins
    met: bool
    rejection_db: float


class Search(Protocol[G]):
    """The gains of one kind that `design` tries, as logarithms."""

    def starts(self, before: G, period_s: float) -> list[FloatArray]:
        """Start of the search."""

    def gains(self, logs: FloatArray, before: G, period_s: float) -> G:
        """Gains from logarithms that are within floating point's range."""

    def rounded(self, gains: G) -> G:
        """As a person types them."""

    def parts(self, gains: G) -> list[G]:
        """Gains of the loop in its other modes: they need the same margins."""


class PidSearch:
    """Proportional, integral and derivative gain, and the filter of the D term; slew_per_s stays."""

    def starts(self, before: Pid, period_s: float) -> list[FloatArray]:
        starts = [_scaled(before, 1.0, 1.0), _scaled(before, 0.4, 0.15), _scaled(before, 0.2, 0.03)]
        tau_s = max(before.derivative_tau_s, TAU_STEPS[0] * period_s)
        return [np.asarray(np.log([*start, tau_s]), np.float64) for start in starts]

    def gains(self, logs: FloatArray, before: Pid, period_s: float) -> Pid:
        kp, ki, kd, tau = (float(value) for value in np.exp(logs))
        ki = max(ki, kp / LONGEST_INTEGRAL_S)
        tau = min(max(tau, TAU_STEPS[0] * period_s), TAU_STEPS[1] * period_s)
        return replace(before, kp_per_deg=kp, ki_per_deg_s=ki, kd_per_dps=kd, derivative_tau_s=tau)

    def rounded(self, gains: Pid) -> Pid:
        kp, ki, kd, tau = as_typed(gains.kp_per_deg, gains.ki_per_deg_s, gains.kd_per_dps, gains.derivative_tau_s)
        return replace(gains, kp_per_deg=kp, ki_per_deg_s=ki, kd_per_dps=kd, derivative_tau_s=tau)

    def parts(self, gains: Pid) -> list[Pid]:
        return []


def design(loop: Loop[G], before: G, wanted: Wanted, search: Search[G]) -> Design[G]:
    """The gains that are the best for this loop."""
    from scipy.optimize import minimize

    period_s = 0.499 / float(loop.hz[-1])
    slow = loop.hz >= LOWEST_REJECTED_HZ

    def gains_of(logs: FloatArray) -> G:
        return search.gains(np.clip(logs, -30.0, 30.0), before, period_s)

    def rejection(gains: G) -> float:
        """Mean square of the tilt that a unit of disturbance makes, in dB."""
        response = np.abs(loop.tilt / (1.0 + loop.gain(gains)))[slow]
        return 10.0 * math.log10(float(np.mean(response**2)))

    def cost(logs: FloatArray) -> float:
        gains = gains_of(logs)
        found = [loop.margins(one) for one in (gains, *search.parts(gains))]
        if not all(math.isfinite(one.phase_deg) for one in found):
            return UNSTABLE
        return rejection(gains) + STEEP * sum(shortfall(one, wanted) for one in found)

    starts = search.starts(before, period_s)
    best, least = starts[0], math.inf
    for logs in starts:
        for _ in range(SEARCHES):  # a simplex that has collapsed begins again where it stopped
            found = minimize(cost, logs, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3, "maxfev": 400})
            logs = found.x
        if float(found.fun) < least:
            best, least = logs, float(found.fun)
    gains = search.rounded(gains_of(best))
    reached = loop.margins(gains)
    met = all(meets(one, wanted) for one in (reached, *(loop.margins(part) for part in search.parts(gains))))
    return Design(gains, reached, met, rejection(gains) - rejection(before))


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


def as_typed(*gains: float) -> list[float]:
    """As a person types them."""
    return [float(f"{gain:.3g}") for gain in gains]

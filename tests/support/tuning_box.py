"""The corners of the box of tunings that must be accepted."""

from __future__ import annotations

import itertools
from dataclasses import replace

from plumb.spec.tuning import Kalman, Pid, Start, Trust
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.tuning import QuadTuning

PAPER = quad.TUNINGS["paper"]
CORNERS = list(
    itertools.product((500, 100_000), (1e-6, 10.0), (1e-8, 1.0), (1e-3, 1e3), (0.0, 180.0**2), (0.0, 500.0**2))
)


def corner(period_us: int, q_angle: float, q_bias: float, r: float, p00: float, p11: float) -> QuadTuning:
    """The accepted box; the pid's gains are those that fit at 2 kHz as well as at 10 Hz."""
    return replace(
        PAPER,
        period_us=period_us,
        pid=Pid(0.035, 0.06, 0.008, derivative_tau_s=0.01, slew_per_s=20.0),
        kalman=Kalman(q_angle, q_bias),
        trust=Trust(r),
        start=Start(p00_deg2=p00, p11_dps2=p11),
    )

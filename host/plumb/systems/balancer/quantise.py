"""Quantise the tuning of `balancer`, and back."""

from __future__ import annotations

from fractions import Fraction

from plumb.contract.parameters import ControlParams
from plumb.spec.settings import FILTER, to_number
from plumb.systems.balancer.settings import Drive, SpeedLoop, Wheel
from plumb.systems.balancer.tuning import EDGES_MOST, SPEED_MOST_MPS, BalancerTuning
from plumb.tuning.declared import setting_words, settings_of
from plumb.tuning.groups import axis_of, axis_words
from plumb.tuning.variances import in_variances
from plumb.tuning.whole import refuse

LEAN_MOST_DEG = 22.5


def quantise(tuning: BalancerTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    shared, lsb_deg2 = axis_words(tuning)
    lean = tuning.speed.lean_max_deg
    if not 0 < lean <= LEAN_MOST_DEG:
        reason = f"leans are more than 0 and at most {LEAN_MOST_DEG:g} deg"
        refuse("speed.lean_max_deg", lean, reason, 0.0, LEAN_MOST_DEG)
    share = to_number(FILTER, tuning.wheel.tau_s, {"dt": Fraction(int(tuning.period_us), 10**6)})
    own = setting_words(tuning, {"lean_max": Fraction(lean), "share": share})
    edges_max = _edges_max(tuning.wheel.edges_max, own["wheel.edge_mps_q26"])
    return ControlParams.of("balancer", {**shared, **own, **edges_max}, in_variances(float(lsb_deg2)))


def _edges_max(asked: int, edge_mps_q26: int) -> dict[str, int]:
    most = min((int(SPEED_MOST_MPS) << 26) // abs(edge_mps_q26) if edge_mps_q26 else EDGES_MOST, EDGES_MOST)
    if not 0 <= asked <= most or asked != int(asked):
        reason = f"whole edges up to {most}, which are 15 m/s at this period; 0 takes as many"
        refuse("wheel.edges_max", asked, reason, 0, most)
    return {"wheel.edges_max": int(asked) or most}


def dequantise(params: ControlParams) -> BalancerTuning:
    """The tuning that the integers represent."""
    p, name = params.values, BalancerTuning.system
    for word in ("wheel.alpha_q31", "speed.d_alpha_q31"):
        if not p[word]:
            raise ZeroDivisionError(f"{word} is 0, a filter that never follows")
    names = {"lean_max": p["drive.lean_max_turn_q34"] / 2**34 * 360, "share": p["wheel.alpha_q31"] / 2**31}
    edges = {"wheel.edges_max": p["wheel.edges_max"]}
    return BalancerTuning(
        **axis_of(params),
        wheel=settings_of(Wheel, params, "wheel", names, edges, name),
        speed=settings_of(SpeedLoop, params, "speed", names, system=name),
        drive=settings_of(Drive, params, "drive", system=name),
    )

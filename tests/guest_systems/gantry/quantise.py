"""`gantry`: its tuning as integers, and back."""

from __future__ import annotations

from plumb.systems.gantry.tuning import GantryTuning

from plumb.contract.parameters import ControlParams


def quantise(tuning: GantryTuning) -> ControlParams:
    period = round(tuning.period_us * 1e-6 * 2**32)
    return ControlParams.of("gantry", {"gantry.dt_s_q32": period, "gantry.step_counts": tuning.most_counts})


def dequantise(params: ControlParams) -> GantryTuning:
    return GantryTuning(round(params.period_s * 1e6), params["gantry.step_counts"])

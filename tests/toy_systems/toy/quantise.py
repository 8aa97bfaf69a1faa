"""`toy`: its tuning as integers, and back."""

from __future__ import annotations

from plumb.systems.toy.tuning import ToyTuning

from plumb.contract.parameters import ControlParams


def quantise(tuning: ToyTuning) -> ControlParams:
    own = {
        "toy.dt_s_q32": round(tuning.period_us * 1e-6 * 2**32),
        "toy.raw_max": tuning.largest_counts,
        "toy.share_q16": round(tuning.share * 2**16),
    }
    return ControlParams.of("toy", own)


def dequantise(params: ControlParams) -> ToyTuning:
    share = params["toy.share_q16"] / 2**16
    return ToyTuning(round(params.period_s * 1e6), params["toy.raw_max"], share)

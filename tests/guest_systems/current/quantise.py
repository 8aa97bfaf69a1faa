"""`current`: its tuning as integers, and back."""

from __future__ import annotations

from plumb.systems.current.tuning import CurrentTuning

from plumb.contract.parameters import ControlParams


def quantise(tuning: CurrentTuning) -> ControlParams:
    own = {
        "dt_s_q32": round(tuning.period_us * 1e-6 * 2**32),
        "zero_counts": tuning.zero_counts,
        "gain_a_q20": round(tuning.amps_per_count * 2**20),
        "kp_q15": round(tuning.kp_per_a * 2**15),
        "ki_q30": round(tuning.ki_per_a_s * tuning.period_s * 2**30),
        "duty_max_q15": round(tuning.duty_max * 2**15),
        "trip_a_q20": round(tuning.trip_a * 2**20),
    }
    return ControlParams.of("current", {f"current.{name}": value for name, value in own.items()})


def dequantise(params: ControlParams) -> CurrentTuning:
    return CurrentTuning(
        round(params.period_s * 1e6),
        params["current.zero_counts"],
        params["current.gain_a_q20"] / 2**20,
        params["current.kp_q15"] / 2**15,
        params["current.ki_q30"] / 2**30 / params.period_s,
        params["current.duty_max_q15"] / 2**15,
        params["current.trip_a_q20"] / 2**20,
    )

"""Properties of the vehicle from a recorded flight of `quadrotor`, for `plumb tune vehicle`."""

from __future__ import annotations

import numpy as np

from plumb.analyses.identification.vehicle_fit import FlownVehicle, VehicleFit, in_the_air
from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams
from plumb.kernels.reference.kernels import calibrate
from plumb.spec.records import Words
from plumb.systems.quadrotor.fixed import FLIES
from plumb.systems.quadrotor.quantise import dequantise
from plumb.tuning.channels import NO_SAMPLE

AXES = 3


def vehicle(params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> FlownVehicle:
    """The flight with these parameters and inputs; a step without a sample has the acceleration before."""
    return of_words(params, raw, run_fixed.run_control(params, raw, setpoint))


def of_words(params: ControlParams, raw: RawCounts, words: Words) -> FlownVehicle:
    """The same, from the steps that were computed."""
    settings = dequantise(params).attitude
    force_g = np.asarray(
        calibrate(raw[:, AXES : 2 * AXES].astype(np.float64), settings.accel)
        @ np.array(settings.accel_mounting.matrix).T,
        np.float64,
    )
    last = np.maximum.accumulate(np.where(raw[:, 0] == NO_SAMPLE, 0, np.arange(len(raw))))
    rate, up = (
        np.stack([np.asarray(words[f"{name}_{axis}"] * scale, np.float64) for axis in range(AXES)], 1)
        for name, scale in (("rate_turnps_q28", 2.0 * np.pi / 2.0**28), ("up_q30", 1.0 / 2.0**30))
    )
    thrust = np.asarray(words["thrust_q24"] / 2.0**24, np.float64)
    turns = np.asarray(words["flags"] & FLIES != 0)
    return FlownVehicle(params.period_s, rate, force_g[last], up, thrust, in_the_air(thrust, turns, params.period_s))


def settings(fit: VehicleFit) -> dict[str, float]:
    """Settings of the tuning."""
    return {"attitude.aid.drag_per_s": fit.drag_per_s.value, "attitude.aid.hover": fit.hover.value}

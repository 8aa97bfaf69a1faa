"""The loop closed on the estimate of `balancer`, with the integers and with float64, and how each run is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.boards.native import plant as native_plant
from plumb.contract.parameters import quantise
from plumb.judging.balancer.plots import DUTY, TURN_DEG
from plumb.kernels.reference import kernels as reference_kernels
from plumb.proof import metrics
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer import reference as reference_balancer
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer.drawn_run import VELOCITY_UNIT, Scenario
from plumb.systems.balancer.plant import BalancerPlant
from plumb.systems.balancer.tuning import BalancerTuning

SETTLED_S = 5.0
"""A command counts as carried out, or not, so long after it."""


class Integers:
    """The C integers, from counts to tilt in deg and duty in -1..1."""

    def __init__(self, tuning: BalancerTuning) -> None:
        self.controller = native_core.Controller(quantise(tuning))

    def step(self, raw: tuple[int, ...], setpoint: int) -> tuple[float, float]:
        words = self.controller.step(raw, setpoint)
        return words["tilt_turn_q32"] * TURN_DEG, words["duty_q15"] * DUTY


class Float64:
    """`plumb.contract.run_reference`, from counts to tilt in deg and duty in -1..1."""

    def __init__(self, tuning: BalancerTuning) -> None:
        self.tuning, self.wheel = tuning, reference_balancer.WheelState()
        self.state = reference_balancer.BalancerReferenceState(reference_kernels.kalman_init(tuning.start))

    def step(self, raw: tuple[int, ...], setpoint: int) -> tuple[float, float]:
        tuning, axis = self.tuning, self.tuning.calibration
        rate_dps, x_g, z_g = (
            reference_kernels.calibrate(float(count), channel)
            for count, channel in zip(raw[:3], (axis.gyro, axis.accel, axis.accel_up), strict=True)
        )
        _, velocity_mps, accel_g = reference_balancer.wheel_step(
            self.wheel, tuning.wheel, tuning.period_s, float(raw[3])
        )
        x_g += accel_g
        z_deg, r_deg2 = reference_kernels.tilt(x_g, z_g, tuning.tilt), reference_kernels.trust(x_g, z_g, tuning.trust)
        asked_mps = setpoint / VELOCITY_UNIT
        step = reference_balancer.control_step(
            self.state, tuning, rate_dps, float(z_deg), float(r_deg2), velocity_mps, accel_g, asked_mps
        )
        return float(step["tilt_deg"]), float(step["duty"])


@dataclass(frozen=True)
class Balanced:
    """One closed loop: error of the estimate over the scored samples, largest true tilt, velocity asked for minus true
    velocity (rms over the scored samples; and over those at least SETTLED_S behind the last command)."""

    error_rms_deg: float
    tilt_max_deg: float
    velocity_rms_mps: float
    settled_rms_mps: float


def balance(controller: Integers | Float64, name: str, seed: int, seconds: float | None = None) -> Balanced:
    """One closed loop on this machine: the plant's counts in, the duty of the same step out."""
    scenario = balancer.scenario(name, seed, seconds=seconds)
    plant = BalancerPlant(scenario)
    setpoint, duty = scenario.setpoint().tolist(), None
    rows = np.empty((scenario.steps, 3))
    for k, time_s in enumerate(scenario.time_s.tolist()):
        plant.drive_to(time_s, duty)
        tilt_deg, duty = controller.step(plant.counts(time_s), setpoint[k])
        true = plant.truth(time_s)
        rows[k] = true["tilt_deg"], tilt_deg, true["velocity_mps"]
    return _judged(scenario, rows[:, 0], rows[:, 1], rows[:, 2])


def balanced(tuning: BalancerTuning, name: str, seed: int) -> Balanced:
    """The same with the integers and the plant in C, which gives the same counts."""
    scenario = balancer.scenario(name, seed)
    found = native_plant.closed_loop(scenario, quantise(tuning))
    estimate_deg = np.asarray(found.words["tilt_turn_q32"] * TURN_DEG)
    return _judged(scenario, found.truth["tilt_deg"], estimate_deg, found.truth["velocity_mps"])


def _judged(scenario: Scenario, true_deg: FloatArray, estimate_deg: FloatArray, velocity_mps: FloatArray) -> Balanced:
    scored, setpoint = scenario.scored, scenario.setpoint()
    apart = metrics.wrap_deg(estimate_deg - true_deg)[scored]
    slip = velocity_mps - setpoint / VELOCITY_UNIT
    settled = scored & settled_since(setpoint, scenario.time_s)
    return Balanced(
        float(np.sqrt(np.mean(apart**2))),
        float(np.max(np.abs(true_deg))),
        float(np.sqrt(np.mean(slip[scored] ** 2))),
        float(np.sqrt(np.mean(slip[settled] ** 2))) if settled.any() else float("nan"),
    )


def settled_since(
    setpoint: npt.NDArray[np.integer[Any]],  # Any: of any width
    time_s: FloatArray,
) -> npt.NDArray[np.bool_]:
    """The samples at least SETTLED_S behind the last change of the setpoint, (steps,)."""
    changed = np.flatnonzero(np.diff(setpoint, prepend=setpoint[:1]))
    last = np.searchsorted(changed, np.arange(len(setpoint)), side="right") - 1
    since_s = time_s - np.where(last >= 0, time_s[changed[last]] if len(changed) else 0.0, -np.inf)
    return np.asarray(since_s >= SETTLED_S)

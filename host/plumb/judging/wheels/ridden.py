"""Rides of `wheels` over many seeds: the C integers in the loop."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from plumb.boards import native_core
from plumb.spec.arrays import FloatArray
from plumb.systems.wheels import scenarios as wheels
from plumb.systems.wheels.plant import Duties, WheelsPlant
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.tuning.quantise import quantise

TURN_DEG, RATE_DPS, DUTY, FALLEN = 360.0 / 2.0**32, 360.0 / 2.0**28, 2.0**-15, 1 << 7
COAST: Duties = (None, None)


@dataclass(frozen=True)
class Ridden:
    """Of every step and run, (steps, runs): error_deg: of the estimate; velocity, turn: true; duty: the larger of both
    motors. time_s: (steps,)."""

    time_s: FloatArray
    error_deg: FloatArray
    tilt_deg: FloatArray
    velocity_mps: FloatArray
    asked_mps: FloatArray
    turn_dps: FloatArray
    asked_dps: FloatArray
    duty: FloatArray
    phase: FloatArray
    fallen: FloatArray

    def between(self, begin_s: float, end_s: float) -> slice:
        """The steps of a time."""
        first, last = np.searchsorted(self.time_s, (begin_s - 1e-9, end_s - 1e-9))
        return slice(int(first), int(last))


def one_ride(name: str, seed: int, tuning: WheelsTuning, late_steps: int = 0) -> FloatArray:
    """The columns of a ride, (columns, steps). late_steps: further delay of the duties."""
    run = wheels.scenario(name, seed, period_us=tuning.period_us)
    plant, core = WheelsPlant(run), native_core.Controller(quantise(run.fit(tuning)))
    duties, waiting = COAST, [COAST] * late_steps
    rows = []
    for time_s in run.time_s.tolist():
        waiting.append(duties)
        plant.drive_to(time_s, waiting.pop(0))
        words = core.step(plant.counts(time_s), plant.setpoint(time_s))
        duties = words["duty_left_q15"] * DUTY, words["duty_right_q15"] * DUTY
        true = plant.truth(time_s)
        rows.append((
            words["tilt_turn_q32"] * TURN_DEG - true["tilt_deg"], true["tilt_deg"], true["velocity_mps"],
            true["asked_mps"], true["turn_dps"], true["asked_dps"], max(abs(duty) for duty in duties),
            words["phase"], bool(words["flags"] & FALLEN),
        ))  # fmt: skip
    return np.array(rows, np.float64).T


def ride(name: str, seeds: Iterable[int], tuning: WheelsTuning = wheels.STEERED, late_steps: int = 0) -> Ridden:
    """One scenario, all seeds."""
    runs = np.stack([one_ride(name, seed, tuning, late_steps) for seed in seeds], -1)
    time_s = np.arange(runs.shape[1]) * tuning.period_s
    return Ridden(np.asarray(time_s, np.float64), *(np.asarray(column, np.float64) for column in runs))

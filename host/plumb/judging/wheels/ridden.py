"""Rides of `wheels` over many seeds: the C integers in the loop, and the plant in C where no duty is late."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.boards.native import core as native_core
from plumb.boards.native import plant as native_plant
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof import moments
from plumb.spec.arrays import FloatArray
from plumb.systems.wheels import scenarios as wheels
from plumb.systems.wheels.drawn_run import Scenario
from plumb.systems.wheels.plant import Duties, WheelsPlant
from plumb.systems.wheels.tuning import WheelsTuning

TURN_DEG, RATE_DPS, DUTY, FALLEN = 360.0 / 2.0**32, 360.0 / 2.0**28, 2.0**-15, 1 << 7
COAST: Duties = (None, None)
WORDS = ("tilt_turn_q32", "duty_left_q15", "duty_right_q15", "phase", "flags")
Columns = Mapping[str, npt.NDArray[Any]]  # Any: integers of any width


@dataclass(frozen=True)
class Ridden:
    """Signals of every step and run, (steps, runs): error_deg: of the estimate; velocity, turn: true; duty: the larger
    of both motors. time_s: (steps,). happens_s: when the event of each run comes, (runs,)."""

    time_s: FloatArray
    happens_s: FloatArray
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
        """The steps of a time that all runs have in common."""
        first, last = np.searchsorted(self.time_s, (begin_s - 1e-9, end_s - 1e-9))
        return slice(int(first), int(last))

    def around(self, values: FloatArray, begin_s: float, end_s: float = np.inf) -> FloatArray:
        """The rows of each run from begin_s to end_s behind its event, as many of all runs."""
        return moments.around(values, self.time_s, self.happens_s + begin_s, self.happens_s + end_s)


def ride(name: str, seeds: Iterable[int], tuning: WheelsTuning = wheels.STEERED, late_steps: int = 0) -> Ridden:
    """One scenario, all seeds. late_steps: further delay of the duties."""
    drawn = [wheels.scenario(name, seed, period_us=tuning.period_us) for seed in seeds]
    columns = [_columns(*_rows(run, quantise(run.fit(tuning)), late_steps)) for run in drawn]
    happens_s = np.array([run.ride.happens_s for run in drawn])
    return Ridden(drawn[0].time_s, happens_s, *(np.stack(column, -1) for column in zip(*columns, strict=True)))


def _rows(run: Scenario, params: ControlParams, late_steps: int) -> tuple[Columns, Columns]:
    """Words and true state of every step, by name. The plant in C has no late duties."""
    if not late_steps:
        answer = native_plant.closed_loop(run, params)
        return {name: answer.words[name] for name in WORDS}, answer.truth
    plant, core = WheelsPlant(run), native_core.Controller(params)
    duties, waiting = COAST, [COAST] * late_steps
    words, truth = [], []
    for time_s in run.time_s.tolist():
        waiting.append(duties)
        plant.drive_to(time_s, waiting.pop(0))
        found = core.step(plant.counts(time_s), plant.setpoint(time_s))
        duties = found["duty_left_q15"] * DUTY, found["duty_right_q15"] * DUTY
        words.append([found[name] for name in WORDS])
        truth.append(plant.truth(time_s))
    return dict(zip(WORDS, np.array(words).T, strict=True)), {
        name: np.array([row[name] for row in truth]) for name in truth[0]
    }


def _columns(words: Columns, true: Columns) -> tuple[FloatArray, ...]:
    """The columns of Ridden from error_deg on, of one run."""
    duty = np.maximum(np.abs(words["duty_left_q15"]), np.abs(words["duty_right_q15"])) * DUTY
    return (
        words["tilt_turn_q32"] * TURN_DEG - true["tilt_deg"], true["tilt_deg"], true["velocity_mps"],
        true["asked_mps"], true["turn_dps"], true["asked_dps"], duty, words["phase"].astype(np.float64),
        (words["flags"] & FALLEN != 0).astype(np.float64),
    )  # fmt: skip

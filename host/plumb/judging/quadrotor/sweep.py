"""Margins of the loops of `quadrotor` on any board, swept in a calm hover (plumb.proof.loop_sweep).

The sine is added to the commands of the rotors, in the pattern of roll, pitch or yaw.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from plumb.boards.contract import StepBoard, Stepper
from plumb.contract.parameters import quantise
from plumb.judging.quadrotor.loops import AMPLITUDE, HIGH_HZ, LOW_HZ, PATTERNS
from plumb.proof.loop_sweep import sines, swept
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import courses
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.plant import QuadrotorPlant, command_of
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.tuning.loop_model import Margins, Response, nearest_margins

HOW = f"Swept in flight on the virtual board in lockstep, {LOW_HZ:g} to {HIGH_HZ:g} Hz, broken at the mixer, seed 1000."
HZ = np.geomspace(LOW_HZ, HIGH_HZ, 32)
SEED = 1000


class Hovering:
    """One axis of a hovering vehicle."""

    def __init__(self, plant: QuadrotorPlant, stepper: Stepper, pattern: FloatArray) -> None:
        self._plant, self._stepper, self._pattern = plant, stepper, pattern
        self._own = np.zeros(4)
        self._command = np.zeros((4, 1))

    def command(self, time_s: float) -> float:
        plant = self._plant
        if time_s > 0.0:
            plant.vehicles.advance(self._command)
        outputs = self._stepper.step(plant.counts(time_s), plant.setpoint(time_s)).outputs
        self._own = command_of(np.array([outputs[f"pulse_halfus_{rotor}"] for rotor in range(4)]))
        return float(self._pattern @ self._own)

    def drive(self, added: float) -> float:
        self._command = np.clip(self._own + self._pattern * added, 0.0, 1.0)[:, None]
        return float(self._pattern @ self._command[:, 0])


def swept_on(
    board: StepBoard,
    axis: str,
    frequencies: FloatArray = HZ,
    tuning: QuadrotorTuning = quadrotor.HUMMINGBIRD,
    period_us: int = quadrotor.PERIOD_US,
) -> Response:
    """Gain of the loop at these frequencies."""
    plan = sines(AMPLITUDE[axis], frequencies, courses.ACTS_S)
    run = quadrotor.scenario("lean", SEED, period_us=period_us, seconds=plan[-1].end_s + 1e-6 * period_us)
    hovering = replace(run, course=replace(courses.LEVEL, seconds=run.steps * 1e-6 * period_us))
    stepper = board.stepper(quantise(run.fit(replace(tuning, period_us=period_us))))
    return swept(
        Hovering(QuadrotorPlant(hovering), stepper, PATTERNS[axis]), plan, run.steps, period_us * 1e-6
    )  # fmt: skip


def margins_on(board: StepBoard) -> Mapping[str, Margins]:
    """Margins of the loop of each axis."""
    return {axis: nearest_margins(HZ, swept_on(board, axis)) for axis in PATTERNS}

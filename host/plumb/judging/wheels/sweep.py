"""Margins of the loops of `wheels` on any board, swept on a ride straight ahead (plumb.proof.loop_sweep).

The sine is added to the duties of both motors: the same to both breaks the loop of balance, with the speed loop closed
around it; opposite ones break the loop of the turn rate. The vehicle rolls, so that neither its dry friction nor the
dead band of its drivers is met; at both ends of its battery, since the motors' torque goes with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from plumb.boards.contract import StepBoard, Stepper
from plumb.contract.parameters import quantise
from plumb.proof.loop_sweep import sines, swept
from plumb.spec.arrays import FloatArray
from plumb.systems.wheels import rides
from plumb.systems.wheels import scenarios as wheels
from plumb.systems.wheels.drawn_run import Scenario
from plumb.systems.wheels.plant import WheelsPlant
from plumb.systems.wheels.tuning import WheelsTuning
from plumb.tuning.loop_model import Margins, Response, nearest_margins

PATTERNS = {"balance": (1.0, 1.0), "turn": (-1.0, 1.0)}
"""Loop -> what a command of it adds to the duties, left and right."""
AMPLITUDE = {"balance": 0.08, "turn": 0.04}
LOW_HZ, HIGH_HZ = 0.4, 99.0
HZ = np.geomspace(LOW_HZ, HIGH_HZ, 32)
SEED, ROLLS_MPS = 1000, 0.6
BEGINS_S = rides.BEGINS_S + 4.0
"""When it rolls at its speed, and a test may begin."""
HOW = (
    f"Swept on a ride at {ROLLS_MPS:g} m/s on the virtual board in lockstep, {LOW_HZ:g} to {HIGH_HZ:g} Hz, broken at"
    f" the duties, seed {SEED}, with {wheels.BATTERY[0]:g} and {wheels.BATTERY[1]:g} of the battery's nominal voltage."
)
FULL = 32768.0


class Rolling:
    """One loop of a rolling vehicle."""

    def __init__(self, plant: WheelsPlant, stepper: Stepper, pattern: tuple[float, float]) -> None:
        self._plant, self._stepper, self._pattern = plant, stepper, pattern
        self._own = self._duties = (0.0, 0.0)

    def command(self, time_s: float) -> float:
        self._plant.drive_to(time_s, self._duties)
        outputs = self._stepper.step(self._plant.counts(time_s), self._plant.setpoint(time_s)).outputs
        self._own = outputs["duty_left_q15"] / FULL, outputs["duty_right_q15"] / FULL
        return self._in_pattern(self._own)

    def drive(self, added: float) -> float:
        left, right = (own + sign * added for own, sign in zip(self._own, self._pattern, strict=True))
        self._duties = min(max(left, -1.0), 1.0), min(max(right, -1.0), 1.0)
        return self._in_pattern(self._duties)

    def _in_pattern(self, duties: tuple[float, float]) -> float:
        return sum(sign * duty for sign, duty in zip(self._pattern, duties, strict=True))


def straight_ahead(tuning: WheelsTuning, seed: int, seconds: float, supply: float | None = None) -> Scenario:
    """A run at ROLLS_MPS on smooth ground. supply: battery by its nominal voltage; None: as the seed draws it."""
    run = wheels.scenario("steps-off", seed, period_us=tuning.period_us, seconds=seconds)
    asked_mps: FloatArray = ROLLS_MPS * np.asarray(run.time_s >= rides.BEGINS_S, np.float64)
    return replace(
        run, ride=replace(rides.STEADY, speed_mps=ROLLS_MPS), supply=run.supply if supply is None else supply,
        asked_mps=asked_mps, push_radps2=0.0 * run.push_radps2,
    )  # fmt: skip


def swept_on(
    board: StepBoard, loop: str, supply: float, frequencies: FloatArray = HZ, tuning: WheelsTuning = wheels.STEERED
) -> Response:
    """Gain of a loop at these frequencies. supply: battery by its nominal voltage."""
    plan = sines(AMPLITUDE[loop], frequencies, BEGINS_S)
    run = straight_ahead(tuning, SEED, plan[-1].end_s + tuning.period_s, supply)
    stepper = board.stepper(quantise(run.fit(tuning)))
    return swept(Rolling(WheelsPlant(run), stepper, PATTERNS[loop]), plan, run.steps, tuning.period_s)


def margins_on(board: StepBoard) -> Mapping[str, Margins]:
    """Margins of each loop at both ends of the battery."""
    return {
        f"{loop}, battery {supply:g}": nearest_margins(HZ, swept_on(board, loop, supply))
        for loop in PATTERNS
        for supply in wheels.BATTERY
    }

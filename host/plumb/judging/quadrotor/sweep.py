"""Margins of the loops of `quadrotor` on any board: one flight an axis, in which one sine follows the other.

The board flies the vehicle of the simulation in lockstep. A sine is added to the commands of the rotors, in the pattern
of roll, pitch or yaw; what the board answers in that pattern, by what the rotors get, is minus the loop's gain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from plumb.boards.contract import Board
from plumb.judging.quadrotor.loops import AMPLITUDE, HIGH_HZ, LOW_HZ, PATTERNS
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import courses
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.plant import QuadrotorPlant, command_of
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.tuning.loop_model import Margins, Response, nearest_margins
from plumb.tuning.quantise import quantise

HOW = f"Swept in flight on the virtual board in lockstep, {LOW_HZ:g} to {HIGH_HZ:g} Hz, broken at the mixer, seed 1000."
HZ = np.geomspace(LOW_HZ, HIGH_HZ, 32)
SEED = 1000
SETTLES_S, MEASURED_S, PERIODS = 0.5, 1.5, 3
"""Before a sine is measured; then for so long at least, and for so many of its periods."""
CORNER_HZ, LARGEST = 8.0, 4.0
"""Above the corner a sine grows with its frequency, since rotors and loop follow it less; at most to LARGEST times."""


@dataclass(frozen=True)
class Sine:
    """One frequency: begun at begin_s, measured from measured_s to end_s, whole periods."""

    hz: float
    amplitude: float
    begin_s: float
    measured_s: float
    end_s: float

    def added(self, time_s: float) -> float:
        return self.amplitude * math.sin(2.0 * math.pi * self.hz * (time_s - self.begin_s))


def sines(axis: str, frequencies: FloatArray) -> list[Sine]:
    """One after the other, from when the pilot begins."""
    found, now_s = [], courses.ACTS_S
    for hz in frequencies.tolist():
        whole = max(math.ceil(MEASURED_S * hz), PERIODS)
        amplitude = AMPLITUDE[axis] * min(max(hz / CORNER_HZ, 1.0), LARGEST)
        found.append(Sine(hz, amplitude, now_s, now_s + SETTLES_S, now_s + SETTLES_S + whole / hz))
        now_s = found[-1].end_s
    return found


def swept_on(
    board: Board,
    axis: str,
    frequencies: FloatArray = HZ,
    tuning: QuadrotorTuning = quadrotor.HUMMINGBIRD,
    period_us: int = quadrotor.PERIOD_US,
) -> Response:
    """Gain of the loop at these frequencies."""
    plan = sines(axis, frequencies)
    run = quadrotor.scenario("lean", SEED, period_us=period_us, seconds=plan[-1].end_s + 1e-6 * period_us)
    hovering = replace(run, course=replace(courses.LEVEL, seconds=run.steps * 1e-6 * period_us))
    plant, stepper = QuadrotorPlant(hovering), board.stepper(quantise(run.fit(replace(tuning, period_us=period_us))))
    pattern, period_s, command = PATTERNS[axis], period_us * 1e-6, np.zeros((4, 1))
    given, got = np.zeros(len(plan), np.complex128), np.zeros(len(plan), np.complex128)
    at = 0
    for step in range(run.steps):
        time_s = step * period_s
        if step:
            plant.vehicles.advance(command)
        outputs = stepper.step(plant.counts(time_s), plant.setpoint(time_s)).outputs
        own = command_of(np.array([outputs[f"pulse_halfus_{rotor}"] for rotor in range(4)]))
        while at < len(plan) - 1 and time_s >= plan[at].end_s:
            at += 1
        sine = plan[at]
        added = sine.added(time_s) if time_s >= sine.begin_s else 0.0
        command = np.clip(own + pattern * added, 0.0, 1.0)[:, None]
        if sine.measured_s <= time_s < sine.end_s:
            turned = np.exp(-2j * np.pi * sine.hz * time_s)
            given[at] += float(pattern @ own) * turned
            got[at] += float(pattern @ command[:, 0]) * turned
    return np.asarray(-given / got)


def margins_on(board: Board) -> Mapping[str, Margins]:
    """Of the loop of each axis."""
    return {axis: nearest_margins(HZ, swept_on(board, axis)) for axis in PATTERNS}

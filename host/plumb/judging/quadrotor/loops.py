"""The whole loop of `quadrotor` as a frequency response, broken at the mixer: swept in flight, with the C integers.

Every run of a batch hovers with a sine of its own frequency added to the commands of its rotors, in the pattern of
roll, pitch or yaw. What the controller gives in that pattern, by what the rotors get, is minus the loop's gain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.physics.airframe import HUMMINGBIRD_X, Airframe
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import courses
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.plant import command_of
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import Vehicles
from plumb.tuning.loop_model import Margins, Response, nearest_margins

PATTERNS = {
    "roll": np.array([-1.0, 1.0, 1.0, -1.0]),
    "pitch": np.array([-1.0, -1.0, 1.0, 1.0]),
    "yaw": np.array([1.0, -1.0, 1.0, -1.0]),
}
"""Axis -> what a command of it adds to the rotors: front right, front left, rear left, rear right."""
AMPLITUDE = {"roll": 0.02, "pitch": 0.02, "yaw": 0.06}
LOW_HZ, HIGH_HZ, POINTS = 0.5, 60.0, 40
"""Up to 60 Hz, since the phase of roll and pitch passes half a turn a little above 30 Hz."""
SETTLES_S, SECONDS = 3.0, 30.0
"""The sine begins when the pilot would, and is measured from SETTLES_S later on."""


def swept(
    axis: str, tuning: QuadrotorTuning, period_us: int, seed: int = 1000, frame: Airframe = HUMMINGBIRD_X
) -> tuple[FloatArray, Response]:
    """Frequencies in Hz, and the gain of the loop there."""
    hz = np.geomspace(LOW_HZ, HIGH_HZ, POINTS)
    run = quadrotor.scenario("lean", seed, period_us=period_us, seconds=SECONDS)
    drawn = [replace(run, course=replace(courses.LEVEL, seconds=SECONDS))] * POINTS
    params = quantise(run.fit(replace(tuning, period_us=period_us)))
    vehicles, core = Vehicles(drawn, frame=frame), native_core.Controllers(params, POINTS)
    pattern, period_s = PATTERNS[axis], period_us * 1e-6
    begin_s = courses.ACTS_S + SETTLES_S
    given, got = np.zeros(POINTS, np.complex128), np.zeros(POINTS, np.complex128)
    # Whole periods of each sine are measured.
    until_s = begin_s + np.floor((SECONDS - begin_s) * hz) / hz
    command = np.zeros((4, POINTS))
    for step in range(run.steps):
        if step:
            vehicles.advance(command)
        words = core.step(np.concatenate([vehicles.counts(), vehicles.commands()], 1), vehicles.throttle_q15())
        own = command_of(np.stack([words[f"pulse_halfus_{rotor}"] for rotor in range(4)]))
        time_s = step * period_s
        sine = AMPLITUDE[axis] * np.sin(2.0 * np.pi * hz * (time_s - courses.ACTS_S))
        added = pattern[:, None] * sine if time_s >= courses.ACTS_S else np.zeros((4, POINTS))
        command = np.clip(own + added, 0.0, 1.0)
        if time_s >= begin_s:
            turned = np.exp(-2j * np.pi * hz * time_s) * (time_s < until_s)
            given += pattern @ own * turned
            got += pattern @ command * turned
    return hz, np.asarray(-given / got)


def margins(
    axis: str,
    tuning: QuadrotorTuning = quadrotor.HUMMINGBIRD,
    period_us: int = quadrotor.PERIOD_US,
    frame: Airframe = HUMMINGBIRD_X,
) -> Margins:
    """Margins of the loop of one axis."""
    return nearest_margins(*swept(axis, tuning, period_us, frame=frame))

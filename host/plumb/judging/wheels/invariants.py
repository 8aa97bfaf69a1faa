"""Invariants of every ride of `wheels`, on the truth of the simulated physics.

Sensors lie while a fault is on them and for LIE_S after it. A ride is over when it has fallen, or a sensor has stopped
it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from plumb.contract.scenario import Scenario
from plumb.judging.wheels.plots import estimate_deg
from plumb.proof.invariants import Violation
from plumb.proof.moments import behind
from plumb.proof.runs import Run
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.wheels import rides
from plumb.systems.wheels.fixed_state import GYRO_UP, LEFT, MOTORS_ON, RECEIVER, RIGHT, STOP_SENSORS, SWITCHES
from plumb.systems.wheels.plant import FAULTY

GONE_S, LIFTED_S, DEAD_S, MOVES_MPS, KERB_S, LIE_S, BEHIND_S = 3.0, 2.0, 0.5, 0.1, 2.0, 5.0, 3.0
FELL_DEG, FAST_MPS, ERROR_DEG, STEEP_DEG, NUMBER, BOTH = 45.0, 2.0, 4.0, 4.0, 255, 3
INVARIANTS = {
    "unasked": "no motor turns while the switch in the receiver's last frame is off, nor while the step says why it is"
    " stopped",
    "gone": f"{GONE_S:g} s after the rider has left, whatever his switch does meanwhile, both duties are 0",
    "lifted": f"no motor turns for {LIFTED_S:g} s in the air, unless both encoders are faulty",
    "dead": f"both encoders without a count for {DEAD_S:g} s, while it moves on the ground at {MOVES_MPS:g} m/s or more"
    " and gyro and accelerometer are right, stop it",
    "good-ride": "nothing is taken for a sensor that lies, or for wheels in the air, but what is; a kerb not for"
    f" {KERB_S:g} s",
    "upright": "while the sensors are right it does not fall by a push, a silent receiver, one encoder, or ice"
    f" under one wheel on a slope of at most {STEEP_DEG:g} deg",
    "fast": f"while the sensors are right and it drives, it is never faster than {FAST_MPS:g} m/s",
    "estimate": f"while the sensors are right and it drives with both wheels on dry ground, the tilt is known to"
    f" {ERROR_DEG:g} deg",
}


def events_drawn(scenario: Scenario) -> int:
    return int(getattr(scenario, "events", 0))


class _Judged:
    """The moments of a run, each (steps,)."""

    def __init__(self, run: Run) -> None:
        truth, words, self.raw = run.inputs.truth, run.board_words, run.inputs.raw
        self.run, self.truth, self.words, self.time_s = run, truth, words, run.inputs.time_s
        self.period_s = run.params.period_s
        self.happening = truth["happening"].astype(np.int64)
        self.duty = np.maximum(np.abs(words["duty_left_q15"]), np.abs(words["duty_right_q15"])) / 2.0**15
        self.flags, self.reason = words["flags"].astype(np.int64), words["stop_reason"].astype(np.int64)
        self.free = self.time_s >= rides.HELD_S
        fell = np.abs(truth["tilt_deg"]) > FELL_DEG
        self.down = np.logical_or.accumulate(fell | (self.free & (self.reason & STOP_SENSORS != 0)))
        self.lies = self.lasts(self.faulty(*range(GYRO_UP + 1)), LIE_S)
        self.lifted, self.kerb = self.on(rides.LIFT), self.on(rides.KERB)
        self.gone = self.on(rides.OFF, rides.CHATTER)

    def on(self, *whats: str) -> BoolArray:
        bits = sum(1 << rides.HAPPENINGS.index(what) for what in whats)
        return np.asarray(self.happening & bits != 0)

    def faulty(self, *channels: int) -> BoolArray:
        return np.asarray(self.happening & sum(1 << (FAULTY + channel) for channel in channels) != 0)

    def lasts(self, on: BoolArray, seconds: float) -> BoolArray:
        """Where it is, and so long after."""
        return behind(on, round(seconds / self.period_s))

    def down_before(self) -> BoolArray:
        """Where it had fallen, or a sensor had stopped it, in the step before."""
        return np.concatenate([[False], self.down[:-1]])

    def since(self, on: BoolArray, seconds: float) -> BoolArray:
        """Where it has lasted for so long."""
        return ~behind(~on, round(seconds / self.period_s))


def violations(run: Run) -> list[Violation]:
    """The first of each kind."""
    j = _Judged(run)
    return [*_stops(j), *_notices(j), *_rides(j)]


def _first(name: str, j: _Judged, broken: BoolArray, value: FloatArray, limit: float) -> Iterator[Violation]:
    if broken.any():
        at = int(np.argmax(broken))
        yield Violation(name, float(j.time_s[at]), float(value[at]), limit)


def _stops(j: _Judged) -> Iterator[Violation]:
    """Values: duty."""
    used, on = j.raw[:, RECEIVER] & NUMBER != 0, j.raw[:, SWITCHES] & MOTORS_ON != 0
    yield from _first("unasked", j, (j.duty > 0.0) & (used & ~on | (j.reason != 0)), j.duty, 0.0)
    yield from _first("gone", j, j.since(j.gone, GONE_S) & (j.duty > 0.0), j.duty, 0.0)
    in_air = j.lifted & ~(j.faulty(LEFT) & j.faulty(RIGHT))
    yield from _first("lifted", j, j.since(in_air & (j.duty > 0.0), LIFTED_S), j.duty, 0.0)


def _notices(j: _Judged) -> Iterator[Violation]:
    """Values: true speed in m/s; the reasons as bits."""
    counts = np.any(np.diff(j.raw[:, LEFT : RIGHT + 1], axis=0, prepend=j.raw[:1, LEFT : RIGHT + 1]) != 0, axis=1)
    speed = np.abs(j.truth["velocity_mps"])
    dead = j.since(~counts & (speed >= MOVES_MPS) & (j.duty > 0.0) & j.free & ~j.lies & ~j.lifted, DEAD_S)
    yield from _first("dead", j, dead, speed, MOVES_MPS)
    begins = (j.reason & STOP_SENSORS != 0) & ~np.concatenate([[True], j.reason[:-1] & STOP_SENSORS != 0])
    excused = j.lies | j.lasts(j.lifted, KERB_S) | j.lasts(j.faulty(LEFT) & j.faulty(RIGHT), KERB_S) | j.down_before()
    yield from _first("good-ride", j, begins & ~excused, j.reason.astype(np.float64), 0.0)


def _rides(j: _Judged) -> Iterator[Violation]:
    """Values: tilt in deg, speed in m/s, error in deg."""
    tilt, speed = np.abs(j.truth["tilt_deg"]), np.abs(j.truth["velocity_mps"])
    icy, steep = j.truth["icy"].astype(np.int64), np.abs(j.truth["slope_deg"]) > STEEP_DEG
    drives = j.free & (j.duty > 0.0) & ~j.down_before()
    lost = j.lies | j.lasts(j.lifted | j.kerb | j.gone | (icy == BOTH) | ((icy != 0) & steep), BEHIND_S)
    lost |= j.lasts(j.faulty(LEFT) & j.faulty(RIGHT) | (j.duty == 0.0), BEHIND_S)
    honest = drives & ~lost
    yield from _first("fast", j, honest & (speed > FAST_MPS), speed, FAST_MPS)
    yield from _first("upright", j, j.free & ~lost & (tilt > FELL_DEG), tilt, FELL_DEG)
    error = np.abs(estimate_deg(j.run) - j.truth["tilt_deg"])
    dry = ~j.lasts((icy != 0) | j.faulty(LEFT) | j.faulty(RIGHT), BEHIND_S)
    yield from _first("estimate", j, honest & dry & (error > ERROR_DEG), error, ERROR_DEG)

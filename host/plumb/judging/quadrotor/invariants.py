"""Invariants of every flight of `quadrotor`, on the truth of the simulated physics.

Sensors lie while a fault is on them and for LIE_S after it; then only the switch is judged. A flight is over with the
first stop of the rotors. An event is the beginning or the end of anything that happens (a cut throttle and a silent
receiver all the time), and the moment from which somebody else flies: pilot, holding, landing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.contract.scenario import Scenario
from plumb.judging.quadrotor.plots import error_deg, flown_deg
from plumb.physics.pilots import DEG
from plumb.proof.invariants import Violation
from plumb.proof.moments import behind
from plumb.proof.runs import Run
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.systems.quadrotor import courses
from plumb.systems.quadrotor import fixed_phase as reasons
from plumb.systems.quadrotor.drawn_run import ACCEL_LIES, GYRO_LIES
from plumb.systems.quadrotor.fixed import AIRBORNE, FLIES, LEVELS, TILT_LIMITED, YAW_LIMITED
from plumb.systems.quadrotor.vehicle import ROTORS_ON

AIR_M, TILT_DEG, CALM_DEG, BEHIND_S, MODE_S, LIE_S = 0.3, 20.0, 10.0, 1.0, 2.5, 10.0
SIGMAS, LIES_STILL_S, STILL_MPS, STILL_DPS = 5.0, 2.0, 0.05, 5.0
BIAS_STEP_DPS, LEARNT_S = 0.1, 20.0
"""A step of the gyro's bias is a lie, too; the filter has so long to learn it."""
FLOWN, STOPPED = 0, 3
UNSURE = 1 << 3
"""Of the flags."""
SWITCHES = 9
"""Place of the switches in the raw counts."""
GROUND = reasons.ON_ITS_BACK | reasons.IDLE | reasons.UNSURE
"""Reasons to stop that only the ground gives."""
INVARIANTS = {
    "stops": f"while the sensors are right, no rotor stops more than {AIR_M:g} m above the ground but by the"
    " switch, a lost receiver with `drop`, a blind gyro, or a runaway",
    "good-flight": "while the sensors are right and all rotors have their thrust, nothing is taken for a runaway"
    " or a crash",
    "tilt": f"in mode level, while the sensors are right, the vertical is at most {TILT_DEG:g} deg from what has"
    f" been asked for {BEHIND_S:g} s, and the lean at most {TILT_DEG:g} deg beyond the largest that was asked for in"
    f" that time, but for saturation, {BEHIND_S:g} s behind an event, {MODE_S:g} s behind a change of the mode, and"
    f" {LEARNT_S:g} s behind a step of the gyro's bias",
    "calm": f"the same while it is unsure: the lean is at most {CALM_DEG:g} deg ({TILT_DEG:g} with a weak rotor) beyond"
    " what is asked for and the error",
    "sigma": f"in the air, while the sensors are right, the error of the vertical is at most {SIGMAS:g} sigma"
    " unless it says that it is unsure",
    "landed": f"with the throttle low, {LIES_STILL_S:g} s of lying still on the ground are known: it may have landed,"
    " and no integral grows",
    "unasked": "no rotor turns while the switch in the receiver's last frame is off",
}


def events_drawn(scenario: Scenario) -> int:
    return int(getattr(scenario, "events", 0))


def _most(values: FloatArray, steps: int) -> FloatArray:
    """The largest of each value and those of so many steps before it."""
    padded = np.concatenate([np.full(steps, -np.inf), values])
    found = padded
    width = 1
    while width <= steps:  # doubled, the rest by one overlapping step
        take = min(width, steps + 1 - width)
        found = np.maximum(found[take:], found[: len(found) - take])
        width += take
    return np.asarray(found)


def _changes(values: npt.NDArray[Any]) -> BoolArray:  # Any: whole numbers or bits
    return np.concatenate([[False], np.diff(values) != 0])


class _Judged:
    """The moments of a run, each (steps,)."""

    def __init__(self, run: Run) -> None:
        truth, words, inputs = run.inputs.truth, run.board_words, run.inputs
        self.run, self.words, self.truth, self.time_s = run, words, truth, inputs.time_s
        self.second = round(BEHIND_S / run.params.period_s)
        self.flags = words["flags"].astype(np.int64)
        happening = truth["happening"].astype(np.int64)
        self.honest = ~behind(happening & (GYRO_LIES | ACCEL_LIES) != 0, round(LIE_S / run.params.period_s))
        bits = {what: 1 << place for place, what in enumerate(courses.HAPPENINGS)}
        lasting = happening & (bits[courses.CUT] | bits[courses.DEAF] | bits[courses.THROTTLE]) != 0
        self.weak = np.logical_or.accumulate(happening & bits[courses.WEAK] != 0)
        self.event = behind(_changes(happening) | _changes(words["phase"].astype(np.int64)) | lasting, self.second)
        levels = self.flags & LEVELS != 0
        self.mode = behind(_changes(levels) | ~levels, round(MODE_S / run.params.period_s))
        limited = behind(self.flags & (TILT_LIMITED | YAW_LIMITED) != 0, self.second)
        stopped = words["phase"] == STOPPED
        self.over = np.logical_or.accumulate(stopped)
        on_ground = bool((truth["clear_m"] != truth["height_m"]).any())
        self.high = truth["clear_m"] > AIR_M if on_ground else np.ones(len(stopped), np.bool_)
        self.on = inputs.raw[:, SWITCHES] & ROTORS_ON != 0
        flown = self.on & (words["phase"] == FLOWN) & (self.flags & FLIES != 0) & ~self.over
        self.air = flown & self.high & (self.time_s >= courses.ACTS_S) & ~behind(truth["pressed"] > 0.0, self.second)
        bias_dps = np.stack([truth[f"bias_{axis}_dps"] for axis in "xyz"])
        stepped = np.concatenate([[False], np.abs(np.diff(bias_dps)).max(axis=0) > BIAS_STEP_DPS])
        known = ~behind(stepped, round(LEARNT_S / run.params.period_s))
        self.quiet = self.air & self.honest & known & levels & ~self.event & ~self.mode & ~limited


def violations(run: Run) -> list[Violation]:
    """The first of each kind."""
    judged = _Judged(run)
    found = [*_stops(judged), *_tilt(judged), *_sigma(judged), *_landed(judged)]
    turning = np.stack([judged.words[f"rotor_q24_{rotor}"] for rotor in range(4)]).max(axis=0) / 2.0**24
    return [*found, *_first("unasked", judged, (turning > 0) & ~judged.on, turning, np.zeros(len(turning)))]


def _first(name: str, judged: _Judged, broken: BoolArray, value: FloatArray, limit: FloatArray) -> Iterator[Violation]:
    if broken.any():
        at = int(np.argmax(broken))
        yield Violation(name, float(judged.time_s[at]), float(value[at]), float(limit[at]))


def _stops(judged: _Judged) -> Iterator[Violation]:
    """Value: the reasons, as bits; limit: those that are allowed."""
    reason = judged.words["stop_reason"].astype(np.float64)
    begins = judged.over & ~np.concatenate([[False], judged.over[:-1]]) & judged.high & judged.honest
    bits = reason.astype(np.int64)
    allowed = np.full(len(bits), float(reasons.NO_SAMPLES | reasons.RECEIVER_LOST | reasons.RUNAWAY | reasons.UPTURNED))
    yield from _first("stops", judged, begins & (bits & GROUND != 0), reason, allowed)
    crash = begins & (bits & (reasons.RUNAWAY | reasons.UPTURNED) != 0) & ~judged.weak
    allowed = np.full(len(bits), float(reasons.NO_SAMPLES | reasons.RECEIVER_LOST))
    yield from _first("good-flight", judged, crash, reason, allowed)
    least = np.stack([judged.words[f"rotor_q24_{rotor}"] for rotor in range(4)]).min(axis=0) / 2.0**24
    yield from _first("stops", judged, judged.air & judged.honest & (least == 0), least, np.zeros(len(least)))


def _tilt(judged: _Judged) -> Iterator[Violation]:
    truth, steps = judged.truth, judged.second
    roll, pitch = truth["asked_roll_deg"], truth["asked_pitch_deg"]
    asked = np.arccos(np.clip(np.cos(roll * DEG) * np.cos(pitch * DEG), -1.0, 1.0)) / DEG
    most, lean = _most(asked, steps), truth["lean_deg"]
    spare = np.where(judged.weak, TILT_DEG, CALM_DEG)
    calm, unsure = most + _most(error_deg(judged.run), steps) + spare, judged.flags & UNSURE != 0
    yield from _first("calm", judged, judged.quiet & unsure & (lean > calm), lean, calm)
    sure = judged.quiet & ~behind(unsure, steps)
    yield from _first("tilt", judged, sure & (lean > most + TILT_DEG), lean, most + TILT_DEG)
    steady = _most(roll, steps) - -_most(-roll, steps) + _most(pitch, steps) - -_most(-pitch, steps) < 10.0
    apart = flown_deg(judged.run)
    yield from _first("tilt", judged, sure & steady & (apart > TILT_DEG), apart, np.full(len(apart), TILT_DEG))


def _sigma(judged: _Judged) -> Iterator[Violation]:
    """In deg."""
    sigma = np.sqrt(judged.words["tilt_variance_rad2_q32"].astype(np.float64) / 2.0**32) / DEG
    error = error_deg(judged.run)
    sure = judged.air & judged.honest & (judged.flags & UNSURE == 0)
    yield from _first("sigma", judged, sure & (error > SIGMAS * sigma), error, SIGMAS * sigma)


def _landed(judged: _Judged) -> Iterator[Violation]:
    """Value: s of lying still."""
    truth, steps = judged.truth, round(LIES_STILL_S / judged.run.params.period_s)
    rate = np.max([np.abs(truth[f"rate_{axis}_dps"]) for axis in "xyz"], axis=0)
    still = (truth["pressed"] > 0.5) & (truth["speed_mps"] < STILL_MPS) & (rate < STILL_DPS)
    still &= (judged.run.inputs.setpoint <= 0) & judged.on & judged.honest & ~judged.over
    still &= judged.time_s >= courses.ACTS_S
    lay = ~behind(~still, steps)
    known = judged.flags & AIRBORNE == 0
    found = np.full(len(lay), LIES_STILL_S)
    yield from _first("landed", judged, lay & ~known, found, found)

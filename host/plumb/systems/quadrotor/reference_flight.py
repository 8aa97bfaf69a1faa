"""Who flies `quadrotor`, in float64: the receiver, what makes the rotors stop, and the phase."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor.tuning import QuadrotorTuning

WEIGHT_G, STILL_DPS = (0.8, 1.2), 20.0
"""Acceleration of a vehicle at rest, and a rate that it does not reach."""


class Phase(Enum):
    FLOWN = auto()
    HELD = auto()
    LANDING = auto()
    STOPPED = auto()


@dataclass(frozen=True)
class Inputs:
    """Of one step. throttle: 0 to 1; sticks: roll, pitch, yaw, -1 to 1; number: of the receiver's newest frame, 0: none
    is in use; signs_off: the receiver says that it has lost the transmitter."""

    throttle: float
    sticks: tuple[float, float, float]
    on: bool
    mode_rate: bool
    number: int
    signs_off: bool


@dataclass(frozen=True)
class Seen:
    """What attitude tells in a step, in body axes, (3,) each."""

    rate_dps: FloatArray
    accel_g: FloatArray
    up: FloatArray
    missing: bool
    airborne: bool
    unsure: bool


@dataclass
class Flight:
    """Counts of steps in a row, and the phase."""

    tuning: QuadrotorTuning
    phase: Phase = Phase.STOPPED
    phase_steps: int = 0
    number: int = 0
    age: int = 0
    good: int = 0
    lost: bool = False
    blind: int = 0
    idle: int = 0
    lying: int = 0
    steps: dict[str, int] = field(init=False)

    def __post_init__(self) -> None:
        receiver, stops = self.tuning.receiver, self.tuning.stops
        times = {
            "lost": receiver.lost_s,
            "held": receiver.held_s,
            "back": receiver.back_s,
            "land": receiver.land_s,
            "blind": stops.blind_s,
            "idle": stops.idle_s,
            "lying": stops.lying_s,
        }
        self.steps = {name: round(seconds / self.tuning.period_s) for name, seconds in times.items()}

    def listen(self, given: Inputs) -> None:
        self.age = self.age + 1 if given.number and given.number == self.number else 0
        self.number = given.number
        self.lost = bool(given.number) and (given.signs_off or self.age >= self.steps["lost"])
        self.good = 0 if self.lost else self.good + 1

    def watch(self, given: Inputs, seen: Seen) -> None:
        low = given.on and given.throttle < self.tuning.mixer.low
        self.blind = self.blind + 1 if seen.missing else 0
        self.idle = self.idle + 1 if low and not seen.airborne else 0
        weighs = WEIGHT_G[0] <= float(np.linalg.norm(seen.accel_g)) <= WEIGHT_G[1]
        rests = weighs and float(np.linalg.norm(seen.rate_dps)) < STILL_DPS
        self.lying = self.lying + 1 if low and rests and not given.mode_rate and seen.up[2] < 0.0 else 0

    def decide(self, given: Inputs, seen: Seen) -> None:
        before = self.phase
        self.phase_steps += 1
        self.phase = self.next_phase(seen) if given.on else Phase.FLOWN
        if self.phase is not before:
            self.phase_steps = 0

    def next_phase(self, seen: Seen) -> Phase:
        """The phase after this one, while the switch is on."""
        steps, phase = self.steps, self.phase
        must_stop = any(getattr(self, name) >= steps[name] for name in ("blind", "idle", "lying"))
        if phase is Phase.STOPPED or must_stop or (seen.unsure and not seen.airborne):
            return Phase.STOPPED
        if phase is Phase.FLOWN and self.lost:
            return Phase.HELD if seen.airborne else Phase.STOPPED
        if phase is Phase.HELD and not self.lost:
            return Phase.FLOWN
        if phase is Phase.HELD and not seen.airborne:
            return Phase.STOPPED
        if phase is Phase.HELD and self.phase_steps > steps["held"]:
            return Phase.LANDING if self.tuning.receiver.lands else Phase.STOPPED
        if phase is Phase.LANDING and self.good >= steps["back"]:
            return Phase.FLOWN
        if phase is Phase.LANDING and (not seen.airborne or self.phase_steps > steps["land"]):
            return Phase.STOPPED
        return phase

    def step(self, given: Inputs, seen: Seen) -> Phase:
        """The phase of this step."""
        self.listen(given)
        self.watch(given, seen)
        self.decide(given, seen)
        return self.phase

"""Who flies `quadrotor`, in float64: the receiver, what makes the rotors stop, and the phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.quantise import G_MPS2
from plumb.systems.attitude.reference_flight import FlightOfBlocks
from plumb.systems.quadrotor.reference_rates import RateLoop
from plumb.systems.quadrotor.tuning import QuadrotorTuning

WEIGHT_G, STILL_DPS = (0.8, 1.2), 20.0
"""Acceleration of a vehicle at rest, and a rate that it does not reach."""
UPRIGHT = 0.5
"""Cosine of 60 deg: a vehicle at rest that leans further lies there."""
RUNAWAY_DPS, WATCHED_BLOCKS = 60.0, 8
"""A runaway at the take-off is faster; blocks of flight in which it stops the rotors."""
TOUCHED_BLOCKS, TOUCHDOWN_BLOCKS = 2, 20
"""Carried blocks after which the integrals stay, and after which a landing with idle rotors has ended."""
DESCENT_GAIN, DESCENT_PER_BLOCK, THRUST_MOST, TOUCHED_SHARE = 1.5, 3.0 / 16.0, 1.25, 0.25
"""Of a landing, in thrusts of a hover: by the error of the descent in g s, and the sum of it; the most; and what a
block that the ground may carry takes off."""


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
    """The outputs of attitude in a step, in body axes, (3,) each."""

    rate_dps: FloatArray
    accel_g: FloatArray
    up: FloatArray
    missing: bool
    flight: FlightOfBlocks
    block_ends: bool
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
    away: int = 0
    upturned: int = 0
    limited: bool = False
    """Roll and pitch of the step before were."""
    landing: float = 0.0
    throttle: float = 0.0
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
            "away": stops.runaway_s,
            "upturned": stops.upturned_s,
        }
        self.steps = {name: round(seconds / self.tuning.period_s) for name, seconds in times.items()}

    def listen(self, given: Inputs) -> None:
        self.age = self.age + 1 if given.number and given.number == self.number else 0
        self.number = given.number
        self.lost = bool(given.number) and (given.signs_off or self.age >= self.steps["lost"])
        self.good = 0 if self.lost else self.good + 1

    def watch(self, given: Inputs, seen: Seen, loops: Sequence[RateLoop]) -> None:
        low = given.on and given.throttle < self.tuning.mixer.low
        self.blind = self.blind + 1 if seen.missing else 0
        self.idle = self.idle + 1 if low and not seen.flight.airborne else 0
        weighs = WEIGHT_G[0] <= float(np.linalg.norm(seen.accel_g)) <= WEIGHT_G[1]
        rests = weighs and float(np.linalg.norm(seen.rate_dps)) < STILL_DPS
        self.lying = self.lying + 1 if low and rests and not given.mode_rate and seen.up[2] < UPRIGHT else 0
        levels = not given.mode_rate or self.phase is not Phase.FLOWN
        self.upturned = self.upturned + 1 if given.on and levels and seen.up[2] < 0.0 else 0
        grows = any(grows_against(loop, rate) for loop, rate in zip(loops, seen.rate_dps[:2].tolist(), strict=True))
        self.away = max(self.away + (1 if self.limited and grows and not low else -1), 0)
        if not seen.flight.landed and seen.flight.flown_blocks >= WATCHED_BLOCKS:
            self.away = 0

    def decide(self, given: Inputs, seen: Seen) -> None:
        before = self.phase
        self.phase_steps += 1
        self.phase = self.next_phase(seen) if given.on else Phase.FLOWN
        if self.phase is not before:
            self.phase_steps = 0

    def next_phase(self, seen: Seen) -> Phase:
        """The phase after this one, while the switch is on."""
        steps, phase = self.steps, self.phase
        must_stop = any(getattr(self, name) >= steps[name] for name in ("blind", "lying", "away", "upturned"))
        landed = seen.flight.landed
        if phase is Phase.STOPPED or must_stop or (landed and (seen.unsure or self.idle >= steps["idle"])):
            return Phase.STOPPED
        if phase is Phase.FLOWN and self.lost:
            return Phase.STOPPED if landed else Phase.HELD
        if phase is Phase.HELD and not self.lost:
            return Phase.FLOWN
        if phase is Phase.HELD and landed:
            return Phase.STOPPED
        if phase is Phase.HELD and self.phase_steps > steps["held"]:
            return Phase.LANDING if self.tuning.receiver.lands else Phase.STOPPED
        if phase is Phase.LANDING and self.good >= steps["back"]:
            return Phase.FLOWN
        touched_down = seen.flight.carried_blocks >= TOUCHDOWN_BLOCKS and self.throttle == 0.0
        if phase is Phase.LANDING and (touched_down or self.phase_steps > steps["land"]):
            return Phase.STOPPED
        return phase

    def set_throttle(self, given: Inputs, seen: Seen) -> None:
        """The throttle of the phase: given, held, or that of a landing, which follows a speed of descent."""
        hover, most = seen.flight.hover, THRUST_MOST * seen.flight.hover
        if self.phase is Phase.HELD:
            self.throttle = min(self.throttle, hover)
        elif self.phase is not Phase.LANDING:
            self.throttle = given.throttle
        elif self.phase_steps == 0:
            self.throttle = hover if seen.flight.carried_blocks < TOUCHED_BLOCKS else self.throttle
            self.landing = self.throttle
        elif seen.block_ends and not seen.flight.airborne:
            self.landing = self.throttle = max(self.landing - TOUCHED_SHARE * hover, 0.0)
        elif seen.block_ends:
            off_gs = min(max(-self.tuning.receiver.land_mps / G_MPS2 - seen.flight.climb_gs, -1.0), 1.0)
            self.landing = min(max(self.landing + DESCENT_PER_BLOCK * hover * off_gs, 0.0), most)
            self.throttle = min(max(self.landing + DESCENT_GAIN * hover * off_gs, 0.0), most)

    def step(self, given: Inputs, seen: Seen, loops: Sequence[RateLoop]) -> Phase:
        """The phase of this step. loops: of roll and pitch, before this step."""
        self.listen(given)
        self.watch(given, seen, loops)
        self.decide(given, seen)
        self.set_throttle(given, seen)
        return self.phase


def grows_against(loop: RateLoop, rate_dps: float) -> bool:
    """Whether the rate of an axis grows against the command of the step before."""
    grows = (rate_dps < loop.rate_filtered_dps) == (rate_dps < 0.0)
    return abs(rate_dps) > RUNAWAY_DPS and (loop.demand < 0.0) != (rate_dps < 0.0) and grows

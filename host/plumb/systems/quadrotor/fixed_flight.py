"""Who flies `quadrotor`, in integers: the receiver, what makes the rotors stop, and the phase.

The functions have the names of docs/reference/arithmetic/quadrotor.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, mul, select

FLOWN, HELD, LANDING, STOPPED = range(4)
NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE = 1, 2, 4, 8, 16
"""Bits of stop_reason."""
LONGEST_STEPS = 65535
"""Counters of steps end here."""
RECEIVER_NUMBER, RECEIVER_LOST_BIT = 255, 256
LEAST_WEIGHT_G2_Q18, MOST_WEIGHT_G2_Q18, STILL_TURNPS2_Q24 = 167772, 377487, 51782
"""At rest: 0.8 to 1.2 g, squared; and less than 20 deg/s, squared."""


@dataclass(slots=True)
class FlightState:
    """Words of the record, in order."""

    phase: Integer
    stop_reason: Integer
    phase_steps: Integer
    receiver_number: Integer
    age_steps: Integer
    good_steps: Integer
    blind_steps: Integer
    idle_steps: Integer
    lying_steps: Integer

    def words(self) -> tuple[Integer, ...]:
        counted_receiver = (self.receiver_number, self.age_steps, self.good_steps)
        counted_stops = (self.blind_steps, self.idle_steps, self.lying_steps)
        return (self.phase, self.stop_reason, self.phase_steps, *counted_receiver, *counted_stops)


class Seen(NamedTuple):
    """The throttle that is asked for; and conditions, which the flags of attitude and the switches tell."""

    throttle: Integer
    missing: Integer
    airborne: Integer
    unsure: Integer
    on: Integer
    mode_rate: Integer


def counted(steps: Integer, goes_on: Integer) -> Integer:
    """One step more, or 0."""
    return select(goes_on, clamp(steps + 1, 0, LONGEST_STEPS), 0 * steps)


def listen(c: FlightState, p: Params, receiver: Integer) -> Integer:
    """Whether the receiver is lost."""
    number = receiver & RECEIVER_NUMBER
    c.age_steps = counted(c.age_steps, (number != 0) & (number == c.receiver_number))
    c.receiver_number = number
    says_so = (receiver & RECEIVER_LOST_BIT) != 0
    lost = (number != 0) & (says_so | (c.age_steps >= p["quadrotor.lost_steps"]))
    c.good_steps = select(lost, 0 * number, clamp(c.good_steps + 1, 0, p["quadrotor.back_steps"]))
    return lost


def squared(values: Sequence[Integer]) -> Integer:
    x, y, z = values
    return mul(x, x) + mul(y, y) + mul(z, z)


def watch(
    c: FlightState, p: Params, seen: Seen, rate: Sequence[Integer], accel: Sequence[Integer], up: Integer
) -> None:
    """Count the steps without samples, idle on the ground, and on its back. up: the vertical along the body's z."""
    c.blind_steps = counted(c.blind_steps, seen.missing)
    low = seen.throttle < p["quadrotor.low_q15"]
    c.idle_steps = counted(c.idle_steps, seen.on & low & (seen.airborne == 0))
    length, turning = squared(accel), squared(rate)
    rests = (length >= LEAST_WEIGHT_G2_Q18) & (length <= MOST_WEIGHT_G2_Q18) & (turning < STILL_TURNPS2_Q24)
    c.lying_steps = counted(c.lying_steps, seen.on & low & (seen.mode_rate == 0) & (up < 0) & rests)


def decide(c: FlightState, p: Params, seen: Seen, lost: Integer) -> None:
    """The phase of this step, by that of the step before."""
    before, zero = c.phase, 0 * c.phase
    c.phase_steps = clamp(c.phase_steps + 1, 0, LONGEST_STEPS)
    blind = c.blind_steps >= p["quadrotor.blind_steps"]
    lying = c.lying_steps >= p["quadrotor.lying_limit"]
    idle = c.idle_steps >= p["quadrotor.idle_limit"]
    unsure = select(seen.unsure & (seen.airborne == 0), zero + UNSURE, zero)
    why = select(blind, zero + NO_SAMPLES, select(lying, zero + ON_ITS_BACK, select(idle, zero + IDLE, unsure)))

    lands = p["quadrotor.lost_action"] == 1
    from_flown = select(lost, select(seen.airborne, zero + HELD, zero + STOPPED), before)
    held_out = select(lands, zero + LANDING, zero + STOPPED)
    longer = select(c.phase_steps > p["quadrotor.held_steps"], held_out, before)
    from_held = select(lost, select(seen.airborne == 0, zero + STOPPED, longer), zero + FLOWN)
    ends = (seen.airborne == 0) | (c.phase_steps > p["quadrotor.land_steps"])
    back = c.good_steps >= p["quadrotor.back_steps"]
    from_landing = select(back, zero + FLOWN, select(ends, zero + STOPPED, before))

    after = select(before == FLOWN, from_flown, select(before == HELD, from_held, from_landing))
    reason = select(after == STOPPED, zero + RECEIVER_LOST, c.stop_reason)
    after, reason = select(why != 0, zero + STOPPED, after), select(why != 0, why, reason)
    stopped = before == STOPPED
    after, reason = select(stopped, before, after), select(stopped, c.stop_reason, reason)
    c.phase, c.stop_reason = select(seen.on, after, zero + FLOWN), select(seen.on, reason, zero)
    c.phase_steps = select(c.phase != before, zero, c.phase_steps)

"""Who flies `quadrotor`, in integers: the receiver, what makes the rotors stop, and the phase.

The functions have the names of docs/reference/arithmetic/quadrotor.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.rate_loop import RateLoopState
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32

FLOWN, HELD, LANDING, STOPPED = range(4)
NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE, RUNAWAY, UPTURNED = (1 << bit for bit in range(7))
"""Bits of stop_reason."""
LONGEST_STEPS = 65535
"""Counters of steps end here."""
RECEIVER_NUMBER, RECEIVER_LOST_BIT = 255, 256
LEAST_WEIGHT_G2_Q18, MOST_WEIGHT_G2_Q18, STILL_TURNPS2_Q24 = 167772, 377487, 51782
"""At rest: 0.8 to 1.2 g, squared; and less than 20 deg/s, squared."""
UPRIGHT_Q30 = 1 << 29
"""Cosine of 60 deg."""
RUNAWAY_RATE_Q28, WATCHED_BLOCKS = 44739243, 8
"""60 deg/s; and the blocks after a take-off in which a runaway stops the rotors."""
TOUCHED_BLOCKS, MAYBE_LANDED_BLOCKS, TOUCHDOWN_BLOCKS = 2, 8, 20
"""Blocks in which the ground seems to carry the vehicle: the integrals stay; it may have landed; a landing has
ended."""
DESCENT_MAX_Q28 = 1 << 28


@dataclass(slots=True)
class FlightState:
    """Words of the record, in order."""

    phase: Integer
    stop_reason: Integer
    hover: Integer
    climb: Integer
    carried_blocks: Integer
    phase_steps: Integer
    receiver_number: Integer
    age_steps: Integer
    good_steps: Integer
    blind_steps: Integer
    idle_steps: Integer
    lying_steps: Integer
    runaway_steps: Integer
    upturned_steps: Integer
    landing: Integer
    throttle: Integer

    def words(self) -> tuple[Integer, ...]:
        flown = (self.hover, self.climb, self.carried_blocks)
        counted_receiver = (self.receiver_number, self.age_steps, self.good_steps)
        counted_stops = (
            self.blind_steps, self.idle_steps, self.lying_steps, self.runaway_steps, self.upturned_steps,
        )  # fmt: skip
        throttles = (self.landing, self.throttle)
        return (
            self.phase, self.stop_reason, *flown, self.phase_steps, *counted_receiver, *counted_stops, *throttles,
        )  # fmt: skip


class Seen(NamedTuple):
    """The throttle that is asked for; and conditions, from attitude and the switches. watched: on the ground or shortly
    after the take-off."""

    throttle: Integer
    missing: Integer
    airborne: Integer
    landed: Integer
    watched: Integer
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
    """Count the steps without samples, idle on the ground, on its side or back, and upside down. up: the vertical along
    the body's z."""
    c.blind_steps = counted(c.blind_steps, seen.missing)
    low = seen.throttle < p["quadrotor.low_q15"]
    c.idle_steps = counted(c.idle_steps, seen.on & low & (seen.airborne == 0))
    length, turning = squared(accel), squared(rate)
    rests = (length >= LEAST_WEIGHT_G2_Q18) & (length <= MOST_WEIGHT_G2_Q18) & (turning < STILL_TURNPS2_Q24)
    c.lying_steps = counted(c.lying_steps, seen.on & low & (seen.mode_rate == 0) & (up < UPRIGHT_Q30) & rests)
    levels = (seen.mode_rate == 0) | (c.phase != FLOWN)
    c.upturned_steps = counted(c.upturned_steps, seen.on & levels & (up < 0))


def grows_against(loop: RateLoopState, rate: Integer) -> Integer:
    """Whether the rate of an axis grows against the command of the step before."""
    grown = wrap_i32((rate >> 1) - loop.rate_filtered_turnps_q27)
    opposed = (loop.demand_q24 < 0) != (rate < 0)
    return (abs(rate) > RUNAWAY_RATE_Q28) & opposed & ((grown < 0) == (rate < 0))


def watch_runaway(
    c: FlightState,
    p: Params,
    seen: Seen,
    tilt_limited: Integer,
    loops: Sequence[RateLoopState],
    rate: Sequence[Integer],
) -> None:
    """Count the steps of a runaway. tilt_limited: of the step before; loops: of roll and pitch, before this step."""
    low = seen.on & (seen.throttle < p["quadrotor.low_q15"])
    away = (low == 0) & tilt_limited & (grows_against(loops[0], rate[0]) | grows_against(loops[1], rate[1]))
    steps = select(away, c.runaway_steps + 1, c.runaway_steps - 1)
    c.runaway_steps = select(seen.watched, clamp(steps, 0, LONGEST_STEPS), 0 * steps)


def decide(c: FlightState, p: Params, seen: Seen, lost: Integer) -> None:
    """The phase of this step, by that of the step before."""
    before, zero = c.phase, 0 * c.phase
    c.phase_steps = clamp(c.phase_steps + 1, 0, LONGEST_STEPS)
    blind = c.blind_steps >= p["quadrotor.blind_steps"]
    lying = c.lying_steps >= p["quadrotor.lying_limit"]
    idle = seen.landed & (c.idle_steps >= p["quadrotor.idle_limit"])
    away = c.runaway_steps >= p["quadrotor.runaway_limit"]
    upturned = c.upturned_steps >= p["quadrotor.upturned_limit"]
    why = zero
    for met, reason in (
        (upturned, UPTURNED), (away, RUNAWAY), (seen.landed & seen.unsure, UNSURE), (idle, IDLE),
        (lying, ON_ITS_BACK), (blind, NO_SAMPLES),
    ):  # fmt: skip
        why = select(met, zero + reason, why)

    lands = p["quadrotor.lost_action"] == 1
    from_flown = select(lost, select(seen.landed, zero + STOPPED, zero + HELD), before)
    held_out = select(lands, zero + LANDING, zero + STOPPED)
    longer = select(c.phase_steps > p["quadrotor.held_steps"], held_out, before)
    from_held = select(lost, select(seen.landed, zero + STOPPED, longer), zero + FLOWN)
    touched_down = (c.carried_blocks >= TOUCHDOWN_BLOCKS) & (c.throttle == 0)
    ends = touched_down | (c.phase_steps > p["quadrotor.land_steps"])
    back = c.good_steps >= p["quadrotor.back_steps"]
    from_landing = select(back, zero + FLOWN, select(ends, zero + STOPPED, before))

    after = select(before == FLOWN, from_flown, select(before == HELD, from_held, from_landing))
    reason = select(after == STOPPED, zero + RECEIVER_LOST, c.stop_reason)
    after, reason = select(why != 0, zero + STOPPED, after), select(why != 0, why, reason)
    stopped = before == STOPPED
    after, reason = select(stopped, before, after), select(stopped, c.stop_reason, reason)
    c.phase, c.stop_reason = select(seen.on, after, zero + FLOWN), select(seen.on, reason, zero)
    c.phase_steps = select(c.phase != before, zero, c.phase_steps)


def set_throttle(c: FlightState, p: Params, given: Integer, block_ends: Integer) -> None:
    """The throttle of the phase: given, held, or that of a landing, which follows a speed of descent."""
    most = c.hover + (c.hover >> 2)
    off = clamp(-p["quadrotor.land_gs_q28"] - c.climb, -DESCENT_MAX_Q28, DESCENT_MAX_Q28)
    touches = c.carried_blocks >= MAYBE_LANDED_BLOCKS
    change = select(touches, -(c.hover >> 2), mul(off, 3 * c.hover))
    landing = clamp(c.landing + change, 0, most)
    descending = select(touches, landing, clamp(landing + mul(off, 24 * c.hover), 0, most))

    lands = c.phase == LANDING
    begins = lands & (c.phase_steps == 0)
    follows = lands & (c.phase_steps != 0) & block_ends
    first = select(c.carried_blocks < TOUCHED_BLOCKS, c.hover, c.throttle)
    c.landing = select(begins, first, select(follows, landing, c.landing))
    landed_by = select(begins, first, select(follows, descending, c.throttle))
    held = select(c.throttle < c.hover, c.throttle, c.hover)
    c.throttle = select(lands, landed_by, select(c.phase == HELD, held, given))

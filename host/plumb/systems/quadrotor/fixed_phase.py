"""The phase of `quadrotor` in integers, from the receiver's frames and from conditions that last.

The functions have the names of firmware/systems/quadrotor_phase.c, without plumb_quadrotor_.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.rate_loop import RateLoopState
from plumb.kernels.integers import clamp, mulhi_i32, wrap_i32
from plumb.systems.attitude.fixed_state import MAYBE_LANDED_BLOCKS

FLOWN, HELD, LANDING, STOPPED = range(4)
NO_SAMPLES, ON_ITS_BACK, IDLE, RECEIVER_LOST, UNSURE, RUNAWAY, UPTURNED = (1 << bit for bit in range(7))
"""Bits of stop_reason."""
STEPS_MOST = 65535
NUMBER_MASK, FAILSAFE = 255, 256
QUIET_MIN_Q18, QUIET_MAX_Q18, QUIET_TURNS2_Q24 = 167772, 377487, 51782
"""At rest: 0.8 to 1.2 g, squared; and less than 20 deg/s, squared."""
UPRIGHT_Q30 = 1 << 29
"""Cosine of 60 deg."""
RUNAWAY_RATE_Q28, WATCHED_BLOCKS = 44739243, 8
"""60 deg/s; and the blocks after a take-off in which a runaway stops the rotors."""
TOUCHED_BLOCKS, TOUCHDOWN_BLOCKS = 2, 20
"""Blocks in which the ground seems to carry the vehicle: the integrals stay; a landing has ended."""
DESCENT_Q28 = 1 << 28


@dataclass(slots=True)
class FlightState:
    """Words of the record, in order."""

    hover_q15: int
    climb_gs_q28: int
    carried_blocks: int
    phase: int = STOPPED
    stop_reason: int = 0
    phase_steps: int = 0
    receiver_number: int = 0
    age_steps: int = 0
    good_steps: int = 0
    blind_steps: int = 0
    idle_steps: int = 0
    lying_steps: int = 0
    runaway_steps: int = 0
    upturned_steps: int = 0
    landing_q15: int = 0
    throttle_q15: int = 0

    def words(self) -> tuple[int, ...]:
        return (
            self.phase, self.stop_reason, self.hover_q15, self.climb_gs_q28, self.carried_blocks, self.phase_steps,
            self.receiver_number, self.age_steps, self.good_steps, self.blind_steps, self.idle_steps,
            self.lying_steps, self.runaway_steps, self.upturned_steps, self.landing_q15, self.throttle_q15,
        )  # fmt: skip


def count(steps: int, met: bool) -> int:
    """Steps for which a condition has been met without a break."""
    return min(steps + 1, STEPS_MOST) if met else 0


def listen(f: FlightState, p: Params, receiver: int) -> bool:
    """True while the receiver is lost."""
    number = receiver & NUMBER_MASK
    f.age_steps = count(f.age_steps, number != 0 and number == f.receiver_number)
    f.receiver_number = number
    lost = number != 0 and (receiver & FAILSAFE != 0 or f.age_steps >= p["quadrotor.lost_steps"])
    f.good_steps = 0 if lost else min(f.good_steps + 1, p["quadrotor.back_steps"])
    return lost


def squared(values: Sequence[int]) -> int:
    x, y, z = values
    return mulhi_i32(x, x) + mulhi_i32(y, y) + mulhi_i32(z, z)


def lies(rate: Sequence[int], accel: Sequence[int], up_z: int) -> bool:
    """True when the vehicle lies on its side or back at rest: after a crash. up_z: the vertical along the body's z."""
    return (
        up_z < UPRIGHT_Q30 and QUIET_MIN_Q18 <= squared(accel) <= QUIET_MAX_Q18 and squared(rate) < QUIET_TURNS2_Q24
    )  # fmt: skip


def grows_against(loop: RateLoopState, rate: int) -> bool:
    """True when the rate of an axis grows against the command of the step before."""
    grown = wrap_i32((rate >> 1) - loop.rate_filtered_turnps_q27)
    opposed = (loop.demand_q24 < 0) != (rate < 0)
    return abs(rate) > RUNAWAY_RATE_Q28 and opposed and (grown < 0) == (rate < 0)


def watch_runaway(
    f: FlightState, loops: Sequence[RateLoopState], rate: Sequence[int], *, low: bool, watched: bool, tilt_limited: bool
) -> None:
    """Count the steps of a runaway. tilt_limited: of the step before; loops: of roll and pitch, before this step."""
    limited = tilt_limited and not low
    if not watched:
        f.runaway_steps = 0
    elif limited and (grows_against(loops[0], rate[0]) or grows_against(loops[1], rate[1])):
        f.runaway_steps = min(f.runaway_steps + 1, STEPS_MOST)
    else:
        f.runaway_steps = max(f.runaway_steps - 1, 0)


def reason_to_stop(f: FlightState, p: Params, landed: bool, unsure: bool) -> int:
    """Reason why the rotors must stop in any phase; 0: none."""
    if f.blind_steps >= p["quadrotor.blind_steps"]:
        return NO_SAMPLES
    if f.lying_steps >= p["quadrotor.lying_limit"]:
        return ON_ITS_BACK
    if landed and f.idle_steps >= p["quadrotor.idle_limit"]:
        return IDLE
    if landed and unsure:
        return UNSURE
    if f.runaway_steps >= p["quadrotor.runaway_limit"]:
        return RUNAWAY
    return UPTURNED if f.upturned_steps >= p["quadrotor.upturned_limit"] else 0


def has_touched_down(f: FlightState) -> bool:
    """True when a landing has ended: the ground carries the vehicle although its rotors idle."""
    return f.carried_blocks >= TOUCHDOWN_BLOCKS and f.throttle_q15 == 0


def next_phase(f: FlightState, p: Params, lost: bool, landed: bool) -> int:
    """STOPPED although there is no reason to stop means that the receiver is lost."""
    if f.phase == FLOWN:
        if not lost:
            return FLOWN
        return STOPPED if landed else HELD
    if f.phase == HELD:
        if not lost:
            return FLOWN
        if landed:
            return STOPPED
        if f.phase_steps <= p["quadrotor.held_steps"]:
            return HELD
        return LANDING if p["quadrotor.lost_action"] else STOPPED
    if f.good_steps >= p["quadrotor.back_steps"]:
        return FLOWN
    return STOPPED if has_touched_down(f) or f.phase_steps > p["quadrotor.land_steps"] else LANDING


def decide(f: FlightState, p: Params, *, on: bool, lost: bool, landed: bool, unsure: bool) -> None:
    """The phase of this step, by that of the step before."""
    before, why = f.phase, reason_to_stop(f, p, landed, unsure)
    f.phase_steps = min(f.phase_steps + 1, STEPS_MOST)
    if not on:
        f.phase = FLOWN
        f.stop_reason = 0
    elif before != STOPPED:
        f.phase = STOPPED if why else next_phase(f, p, lost, landed)
        if f.phase == STOPPED:
            f.stop_reason = why or RECEIVER_LOST
    if f.phase != before:
        f.phase_steps = 0


def set_throttle(f: FlightState, p: Params, given_q15: int, block_ends: bool) -> None:
    """The throttle of the phase: given, held, or that of a landing, which follows a speed of descent."""
    hover = f.hover_q15
    most = hover + (hover >> 2)
    if f.phase == HELD:
        f.throttle_q15 = min(f.throttle_q15, hover)
    elif f.phase != LANDING:
        f.throttle_q15 = given_q15
    elif f.phase_steps == 0:
        if f.carried_blocks < TOUCHED_BLOCKS:
            f.throttle_q15 = hover
        f.landing_q15 = f.throttle_q15
    elif block_ends:
        off = clamp(-p["quadrotor.land_gs_q28"] - f.climb_gs_q28, -DESCENT_Q28, DESCENT_Q28)
        touches = f.carried_blocks >= MAYBE_LANDED_BLOCKS
        change = -(hover >> 2) if touches else mulhi_i32(off, 3 * hover)
        f.landing_q15 = clamp(f.landing_q15 + change, 0, most)
        f.throttle_q15 = f.landing_q15 if touches else clamp(f.landing_q15 + mulhi_i32(off, 24 * hover), 0, most)

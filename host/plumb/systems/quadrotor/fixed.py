"""`quadrotor` in integers: counts, throttle and sticks to the pulses of four rotors.

The step is that of docs/reference/arithmetic/quadrotor.md, in the order of firmware/systems/quadrotor.c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed import takeoff, validity
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.rate_loop import RateLoopMode, RateLoopState, rate_loop_step
from plumb.kernels.integers import clamp
from plumb.spec import declarations
from plumb.systems.attitude import fixed as attitude
from plumb.systems.attitude import fixed_state
from plumb.systems.quadrotor.fixed_mixer import ask, mix, rest
from plumb.systems.quadrotor.fixed_phase import (
    FLOWN,
    HELD,
    LANDING,
    STOPPED,
    TOUCHED_BLOCKS,
    WATCHED_BLOCKS,
    FlightState,
    count,
    decide,
    lies,
    listen,
    set_throttle,
    watch_runaway,
)

__all__ = ["control_init", "control_step", "control_valid"]

THROTTLE_MAX_Q15 = 32767
ROTORS_ON, MODE_RATE = 1, 2
AXES = ("roll", "pitch", "yaw")
GYRO_CLIPPED, ACCEL_CLIPPED, MISSING, UNSURE = (1 << bit for bit in range(4))
AIRBORNE, FLIES, LEVELS, LOST, TILT_LIMITED, YAW_LIMITED, THRUST_MOVED, LANDED = (1 << bit for bit in range(4, 12))


@dataclass(slots=True)
class QuadrotorState:
    attitude: fixed_state.AttitudeState
    flight: FlightState
    loops: list[RateLoopState] = field(default_factory=lambda: [RateLoopState() for _ in AXES])
    flags: int = 0
    step: int = 0


def control_init(p: Params) -> QuadrotorState:
    a = attitude.control_init(p)
    a.vehicle = True
    return QuadrotorState(a, FlightState(a.hover_q15, a.climb_gs_q28, a.carried_blocks))


def collective(c: QuadrotorState, p: Params) -> int:
    """Thrust command of the step before, Q15, without what roll and pitch add to it; 0: the rotors are off."""
    return max(c.flight.throttle_q15, p["quadrotor.idle_q24"] >> 9, 1) if c.flags & FLIES else 0


def taken_flags(of_attitude: int) -> int:
    """The flags of attitude that this system has, too."""
    return (
        (GYRO_CLIPPED if of_attitude & fixed_state.GYRO_CLIPPED else 0)
        | (ACCEL_CLIPPED if of_attitude & fixed_state.ACCEL_CLIPPED else 0)
        | (MISSING if of_attitude & fixed_state.MISSING else 0)
        | (UNSURE if of_attitude & fixed_state.UNSURE else 0)
    )


def rate_loop_mode(flies: bool, landed: bool, carried_blocks: int) -> RateLoopMode:
    if not flies:
        return RateLoopMode.OFF
    if landed:
        return RateLoopMode.GROUNDED
    return RateLoopMode.HELD if carried_blocks >= TOUCHED_BLOCKS else RateLoopMode.FLYING


def control_step(c: QuadrotorState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    a, f = c.attitude, c.flight
    roll, pitch, yaw, switches, receiver = raw[6:11]
    c.step += 1

    attitude.control_step(a, p, raw[:6], collective(c, p))
    rate, up = a.rate_turnps_q28, a.up_q30
    f.hover_q15, f.climb_gs_q28, f.carried_blocks = a.hover_q15, a.climb_gs_q28, a.carried_blocks
    airborne = f.carried_blocks < fixed_state.MAYBE_LANDED_BLOCKS
    landed = f.carried_blocks == fixed_state.LANDED_BLOCKS
    flags = taken_flags(a.flags) | (AIRBORNE if airborne else 0) | (LANDED if landed else 0)
    unsure = flags & UNSURE != 0

    given = clamp(setpoint, 0, THROTTLE_MAX_Q15)
    on = switches & ROTORS_ON != 0
    by_rate = switches & MODE_RATE != 0
    low = on and given < p["quadrotor.low_q15"]
    lost = listen(f, p, receiver)
    f.blind_steps = count(f.blind_steps, flags & MISSING != 0)
    f.idle_steps = count(f.idle_steps, low and not airborne)
    f.lying_steps = count(f.lying_steps, low and not by_rate and lies(rate, a.accel_g_q25, up[2]))
    f.upturned_steps = count(f.upturned_steps, on and up[2] < 0 and (not by_rate or f.phase != FLOWN))
    watched = landed or a.flown_blocks < WATCHED_BLOCKS
    watch_runaway(f, c.loops, rate, low=low, watched=watched, tilt_limited=c.flags & TILT_LIMITED != 0)
    decide(f, p, on=on, lost=lost, landed=landed, unsure=unsure)

    flies = on and f.phase != STOPPED
    alone = f.phase in (HELD, LANDING)
    levels = alone or not by_rate
    sticks = (0, 0, 0) if alone else (roll, pitch, yaw)
    set_throttle(f, p, given, a.block_step == 0)
    rate_max = p["quadrotor.tilt_rate_max_q28"]
    error, asked = ask(p, up, sticks, levels, min(rate_max, p["quadrotor.unsure_rate_q28"]) if unsure else rate_max)

    mode = rate_loop_mode(flies, landed, f.carried_blocks)
    alpha, most = p["quadrotor.d_alpha_q31"], p["quadrotor.integral_max_q30"]
    for axis, loop in enumerate(c.loops):
        rate_loop_step(loop, p, f"rate_{AXES[axis]}", alpha, most, asked[axis], rate[axis], mode)

    flags |= (LEVELS if levels else 0) | (LOST if lost else 0)
    if flies:
        free = p["quadrotor.airmode"] != 0 and not landed
        mixed = mix(p, f.throttle_q15, [loop.demand_q24 for loop in c.loops], free)
        flags |= FLIES | (TILT_LIMITED if mixed.tilt_limited else 0)
        flags |= (YAW_LIMITED if mixed.yaw_limited else 0) | (THRUST_MOVED if mixed.thrust_moved else 0)
    else:
        mixed = rest(p)
    for loop, excess in zip(c.loops, mixed.excess, strict=True):
        loop.excess_q24 = excess
    c.flags = flags
    return (
        *raw, setpoint, *rate, *a.attitude, *up, a.tilt_variance_rad2_q32, *f.words(), *error, *asked,
        *(word for loop in c.loops for word in loop.words()), mixed.thrust, *mixed.rotors, *mixed.pulses,
        flags, c.step,
    )  # fmt: skip


def control_valid(p: Params) -> bool:
    """As attitude and the speed controllers, and every word of the declaration within its range."""
    rows = declarations.system("quadrotor").parameters
    within = all(row["min"] <= p[row["name"]] <= row["max"] for row in rows)
    return within and attitude.control_valid(p) and validity.esc(p)


TAKEOFF = takeoff.Bounds(
    throttle="setpoint_throttle_q15",
    rate="rate_turnps_q28",
    up_z="up_q30_2",
    variance="tilt_variance_rad2_q32",
    blind=0b111,
    stands=LANDED,
    throttle_max_q15=round(0.05 * 32767),
    rest_turnps_q28=round(5.0 / 360.0 * 2**28),
    up_z_min_q30=round(math.cos(math.radians(25.0)) * 2**30),
    variance_max_rad2_q32=round(math.radians(3.0) ** 2 * 2**32),
)
"""When it may be armed."""

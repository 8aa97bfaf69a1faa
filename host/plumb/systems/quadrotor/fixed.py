"""`quadrotor` in integers: counts, throttle and sticks to the pulses of four rotors.

The functions have the names of docs/reference/arithmetic/quadrotor.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from plumb.kernels.fixed import takeoff, validity
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.rate_loop import RateLoopMode, RateLoopState, rate_loop_step
from plumb.kernels.integers import Integer, clamp, mul, select
from plumb.spec import declarations
from plumb.systems.attitude import fixed as attitude
from plumb.systems.attitude import fixed_state
from plumb.systems.quadrotor.fixed_flight import (
    HELD,
    LANDING,
    MAYBE_LANDED_BLOCKS,
    STOPPED,
    TOUCHED_BLOCKS,
    WATCHED_BLOCKS,
    FlightState,
    Seen,
    decide,
    listen,
    set_throttle,
    watch,
    watch_runaway,
)  # fmt: skip
from plumb.systems.quadrotor.fixed_mixer import mix

__all__ = ["control_init", "control_step", "control_valid"]

THROTTLE_MAX_Q15 = 32767
AXES = ("roll", "pitch", "yaw")
ONE_Q28, ERROR_MAX_Q28, ON_ITS_BACK_Q28 = 1 << 28, 1 << 29, 1 << 22
"""1, the limit of the error, and one plus the cosine of 170 deg."""
COPIED = ((fixed_state.GYRO_CLIPPED, 0), (fixed_state.ACCEL_CLIPPED, 1), (fixed_state.MISSING, 2),
          (fixed_state.UNSURE, 3))  # fmt: skip
"""Flags of attitude and their bits here."""
AIRBORNE, FLIES, LEVELS, LOST, TILT_LIMITED, YAW_LIMITED, THRUST_MOVED, LANDED = (1 << bit for bit in range(4, 12))


@dataclass(slots=True)
class ControlState:
    attitude: fixed_state.ControlState
    flight: FlightState
    loops: list[RateLoopState]
    collective: Integer
    """Thrust command of the step before, Q15, without what roll and pitch add to it; 0: the rotors are off."""
    tilt_limited: Integer
    step: Integer


def control_init(p: Params) -> ControlState:
    zero = 0 * p["quadrotor.low_q15"]
    loops = [RateLoopState(zero, zero, zero, zero) for _ in AXES]
    flight = FlightState(zero + STOPPED, *[zero] * (len(fields(FlightState)) - 1))
    estimator = attitude.control_init(p)
    estimator.vehicle = zero + 1
    flight.hover, flight.carried_blocks = estimator.hover, estimator.carried_blocks
    return ControlState(estimator, flight, loops, zero, zero != 0, zero)


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step = c.step + 1
    a, f = c.attitude, c.flight
    attitude.control_step(a, p, raw[:6], c.collective)
    seen_flags = a.flags | a.block_flags
    unsure = (seen_flags & fixed_state.UNSURE) != 0
    airborne, landed = a.carried_blocks < MAYBE_LANDED_BLOCKS, a.carried_blocks == fixed_state.LANDED_BLOCKS
    f.hover, f.climb, f.carried_blocks = a.hover, a.climb, a.carried_blocks
    *sticks, switches, receiver = raw[6:11]
    seen = Seen(
        throttle=clamp(setpoint, 0, THROTTLE_MAX_Q15),
        missing=(seen_flags & fixed_state.MISSING) != 0,
        airborne=airborne,
        landed=landed,
        watched=landed | (a.flown_blocks < WATCHED_BLOCKS),
        unsure=unsure,
        on=(switches & 1) != 0,
        mode_rate=(switches & 2) != 0,
    )
    lost = listen(f, p, receiver)
    watch(f, p, seen, a.rate, a.accel, a.up[2])
    watch_runaway(f, p, seen, c.tilt_limited, c.loops, a.rate)
    decide(f, p, seen, lost)

    flies = seen.on & (f.phase != STOPPED)
    alone = (f.phase == HELD) | (f.phase == LANDING)
    set_throttle(f, p, seen.throttle, a.block_step == 0)
    sticks = [select(alone, 0 * stick, stick) for stick in sticks]
    levels = alone | (seen.mode_rate == 0)
    rate_max, slow = p["quadrotor.tilt_rate_max_q28"], p["quadrotor.unsure_rate_q28"]
    error, asked = ask(p, sticks, levels, a.up, select(unsure & (slow < rate_max), slow, rate_max))
    touches = f.carried_blocks >= TOUCHED_BLOCKS
    if not flies:
        mode = RateLoopMode.OFF
    elif landed:
        mode = RateLoopMode.GROUNDED
    else:
        mode = RateLoopMode.HELD if touches else RateLoopMode.FLYING
    alpha, most = p["quadrotor.d_alpha_q31"], p["quadrotor.integral_max_q30"]
    for name, loop, wanted, rate in zip(AXES, c.loops, asked, a.rate, strict=True):
        rate_loop_step(loop, p, f"rate_{name}", alpha, most, wanted, rate, mode)
    mixed = mix(p, flies, landed == 0, f.throttle, [loop.demand_q24 for loop in c.loops])
    least = clamp(p["quadrotor.idle_q24"] >> 9, 1, THROTTLE_MAX_Q15)
    c.collective = select(flies, clamp(f.throttle, least, THROTTLE_MAX_Q15), 0 * least)
    c.tilt_limited = mixed.tilt_limited
    for loop, excess in zip(c.loops, mixed.excess, strict=True):
        loop.excess_q24 = excess

    flags = 0 * c.step
    for bit, to in COPIED:
        flags = flags | select((seen_flags & bit) != 0, 1 << to, 0)
    for condition, bit in (
        (airborne, AIRBORNE), (flies, FLIES), (levels, LEVELS), (lost, LOST), (mixed.tilt_limited, TILT_LIMITED),
        (mixed.yaw_limited, YAW_LIMITED), (mixed.thrust_moved, THRUST_MOVED),
        (landed, LANDED),
    ):  # fmt: skip
        flags = flags | select(condition, bit, 0)
    return (
        *raw, setpoint, *a.rate, *a.attitude, *a.up, a.tilt_variance, *f.words(), *error, *asked,
        *(word for loop in c.loops for word in loop.words()), mixed.thrust, *mixed.rotors, *mixed.pulses,
        flags, c.step,
    )  # fmt: skip


def by_stick(stick: Integer, most: Integer) -> Integer:
    """Share of the most that a stick, Q15, asks for, in the format of the most."""
    return 2 * mul(stick << 16, most)


def ask(
    p: Params, sticks: Sequence[Integer], levels: Integer, up: Sequence[Integer], rate_max: Integer
) -> tuple[list[Integer], list[Integer]]:
    """The error of the vertical, and the rates that are asked for. rate_max: most that the error asks for, turn/s
    Q28."""
    roll, pitch, yaw = sticks
    yaw_rate = by_stick(yaw, p["quadrotor.yaw_rate_max_q28"])
    most = p["quadrotor.stick_rate_q28"]
    by_rate = [by_stick(roll, most), by_stick(pitch, most), yaw_rate]
    error = error_of_vertical(p, roll, pitch, up)
    m = rate_max >> 4
    by_lean = [
        16 * clamp(mul(e, p["quadrotor.tilt_gain_q28"]), -m, m) + 4 * mul(yaw_rate, part)
        for e, part in zip(error, up, strict=True)
    ]
    return (
        [select(levels, e, 0 * e) for e in error],
        [select(levels, lean, rate) for lean, rate in zip(by_lean, by_rate, strict=True)],
    )


def error_of_vertical(p: Params, roll: Integer, pitch: Integer, up: Sequence[Integer]) -> list[Integer]:
    """The turn of the body that brings the vertical to where the sticks want it: the sine of its angle, beyond a right
    angle the tangent of half of it, Q28."""
    wx = -by_stick(pitch, p["quadrotor.tilt_max_q30"])
    wy = by_stick(roll, p["quadrotor.tilt_max_q30"])
    s = 4 * (mul(wx, wx) + mul(wy, wy))
    s2 = mul(s, s)
    s3 = mul(4 * s2, s)
    wz = 4 * (ONE_Q28 - (s >> 3) - (s2 >> 3) - (s3 >> 4))
    sine = [
        mul(wy, up[2]) - mul(wz, up[1]),
        mul(wz, up[0]) - mul(wx, up[2]),
        mul(wx, up[1]) - mul(wy, up[0]),
    ]
    n = ONE_Q28 + mul(wx, up[0]) + mul(wy, up[1]) + mul(wz, up[2])
    k = 0xFFFFFFFF // (clamp(n, ON_ITS_BACK_Q28, ONE_Q28) >> 10)
    tangent = [clamp((e * k) >> 14, -ERROR_MAX_Q28, ERROR_MAX_Q28) for e in sine]
    error = [select(n < ONE_Q28, beyond, e) for beyond, e in zip(tangent, sine, strict=True)]
    roll_over = (ERROR_MAX_Q28, 0, 0)
    return [select(n < ON_ITS_BACK_Q28, over, e) for over, e in zip(roll_over, error, strict=True)]


def control_valid(p: Params) -> bool:
    """As attitude and the speed controllers, and every word of the declaration within its range."""
    rows = declarations.system("quadrotor").parameters
    within = all(row["min"] <= int(p[row["name"]]) <= row["max"] for row in rows)
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

"""`wheels` in integers: counts, speed and turn rate to the duties of two motors.

The functions have the names of firmware/systems/wheels.c.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed import kernels
from plumb.kernels.fixed.kernels import Params, PidState
from plumb.kernels.fixed.rate_loop import RateLoopMode, rate_loop_step
from plumb.kernels.integers import INT32_MAX, clamp, mulhi_i32, wrap_i16
from plumb.spec import declarations
from plumb.systems.balancer import fixed as balancer
from plumb.systems.wheels.fixed_doubt import both, doubt, in_a_row, is_odd, stopped_by
from plumb.systems.wheels.fixed_state import (
    ACCEL_STILL,
    ACCEL_X,
    ACCEL_Z,
    CLOSED_TAKES,
    DRIVES,
    GYRO,
    GYRO_UP,
    GYRO_UP_CLAMPED,
    LEFT,
    LOST,
    MOTORS_ON,
    PITCH,
    RECEIVER,
    RIDDEN,
    RIDER,
    RIGHT,
    ROLL,
    SLIPS,
    STOPPED,
    STOPPING,
    SWITCHES,
    TURN_LIMITED,
    WHEEL_CLAMPED,
    YAW,
    WheelsState,
    control_init,
)

__all__ = ["PLAUSIBLE", "control_init", "control_retune", "control_step", "control_valid"]

FULL_Q15, STEPS_MOST = 32767, 65535
NUMBER_MASK, FAILSAFE = 255, 256
BIAS_MOST = 1 << 27
"""turn/s Q28."""
TURN_MOST = 4 << 28
BALANCER_VALUES = slice(7, -2)
"""Of a record of balancer: from the calibrated gyro to the duty."""


def by_stick(stick: int, most: int) -> int:
    """Share of the most that a stick, Q15, asks for, in the format of the most."""
    return 2 * mulhi_i32(clamp(stick, -FULL_Q15, FULL_Q15) << 16, most)


def listen(c: WheelsState, lost_steps: int, receiver: int) -> bool:
    """True while the receiver is lost."""
    number = receiver & NUMBER_MASK
    same = number != 0 and number == c.receiver_number
    c.age_steps = min(c.age_steps + 1, STEPS_MOST) if same else 0
    c.receiver_number = number
    return number != 0 and (receiver & FAILSAFE != 0 or c.age_steps >= lost_steps)


def decide(c: WheelsState, p: Params, present: bool, blind: bool, on: bool) -> None:
    """The phase of this step, from the tilt of the step before: whether somebody rides, and what happens when the rider
    has left."""
    before = c.phase
    full = p["wheels.absent_steps"]
    c.absent_steps = max(c.absent_steps - CLOSED_TAKES, 0) if present else min(c.absent_steps + 1, full)
    rides = present and c.absent_steps == 0 and not blind
    c.phase_steps = min(c.phase_steps + 1, STEPS_MOST)
    if not on:
        c.phase = STOPPED
    elif before == STOPPED:
        if rides and abs(c.balancer.tilt_turn_q32) <= p["wheels.up_turn_q32"]:
            c.phase = RIDDEN
    elif before == RIDDEN:
        if c.absent_steps >= full or blind:
            c.phase = STOPPING
    elif rides:
        c.phase = RIDDEN
    elif c.phase_steps > p["wheels.stopping_steps"]:
        c.phase = STOPPED
    if c.phase != before:
        c.phase_steps = 0


def turning(c: WheelsState, p: Params, difference: int, count: int) -> int:
    """Turn rate: that of the gyro, its bias taken off, which follows the difference of the wheels slowly; returns
    flags. Where both disagree by more than an encoder's counts can, a wheel slips."""
    gyro, clamped = kernels.calibration_apply(p, "gyro", count)
    used = clamp(difference, -p["wheels.counts_max"], p["wheels.counts_max"])
    rolled = used * p["wheels.count_turnps_q28"]
    apart = (gyro >> 1) - (rolled >> 1) - (c.turn_bias_turnps_q28 >> 1)
    doubt = p["wheels.doubt_turnps_q28"] >> 1
    c.turn_gyro_turnps_q28 = gyro
    c.turn_wheels_turnps_q28 = rolled
    if abs(apart) > p["wheels.slip_turnps_q28"] >> 1:
        c.slip_steps = p["wheels.slip_hold"]
    elif c.slip_steps != 0:
        c.slip_steps -= 1
    if c.slip_steps == 0:
        follows = 4 * mulhi_i32(clamp(apart, -doubt, doubt), p["wheels.bias_alpha_q31"])
        c.turn_bias_turnps_q28 = clamp(c.turn_bias_turnps_q28 + follows, -BIAS_MOST, BIAS_MOST)
    c.turn_rate_turnps_q28 = gyro - c.turn_bias_turnps_q28
    return (GYRO_UP_CLAMPED if clamped else 0) | (WHEEL_CLAMPED if used != difference else 0)


def mix(c: WheelsState, duty_max_q15: int, turn_max_q15: int) -> int:
    """Balance first, turning gets what it leaves; returns flags. While a wheel slips, the other one gets twice the
    duty, and turning nothing."""
    wanted = c.turn.demand_q24 >> 9
    duty, turn = c.balancer.duty_q15, 0
    if c.slip_steps != 0:
        duty = clamp(2 * duty, -duty_max_q15, duty_max_q15)
    else:
        room = min(duty_max_q15 - abs(duty), turn_max_q15)
        turn = clamp(wanted, -room, room)
    c.turn.excess_q24 = (wanted - turn) * 512
    c.turn_duty_q15 = turn
    c.duty_left_q15 = duty - turn
    c.duty_right_q15 = duty + turn
    return TURN_LIMITED if wanted != turn else 0


def control_step(c: WheelsState, p: Params, raw: Sequence[int], setpoint_speed_q15: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    b, before = c.balancer, c.raw
    first = c.step == 0
    left = 0 if first else wrap_i16(raw[LEFT] - before[LEFT])
    right = 0 if first else wrap_i16(raw[RIGHT] - before[RIGHT])
    odd = is_odd(c)
    repeats = not first and (raw[ACCEL_X] == before[ACCEL_X] or raw[ACCEL_Z] == before[ACCEL_Z])
    c.still_steps = in_a_row(c.still_steps, odd or repeats, p["wheels.still_steps"])
    blind = c.still_steps >= p["wheels.still_steps"]
    c.raw = tuple(raw)
    c.step += 1

    lost = listen(c, p["wheels.lost_steps"], raw[RECEIVER])
    on = c.receiver_number == 0 or raw[SWITCHES] & MOTORS_ON != 0
    decide(c, p, raw[RIDER] > 0, blind, on)
    obeys = c.phase == RIDDEN and not lost
    speed = raw[PITCH] if c.receiver_number != 0 else setpoint_speed_q15
    c.asked_mps_q26 = by_stick(speed, p["drive.speed_max_mps_q26"]) if obeys else 0
    c.asked_turnps_q28 = by_stick(raw[YAW] - raw[ROLL], p["wheels.turn_max_turnps_q28"]) if obeys else 0

    if c.phase == STOPPED:
        b.speed, b.pid = PidState(), PidState()
    flags = turning(c, p, right - left, raw[GYRO_UP])
    slips = c.slip_steps != 0
    c.sum_counts = both(c, p, left, right)
    one_wheel = (raw[GYRO], raw[ACCEL_X], raw[ACCEL_Z], wrap_i16(b.hall + c.sum_counts), 0, 0)
    b.blind = blind or odd
    has, most = b.wheel.velocity_mps_q26, p["wheels.slip_mps_q26"]
    wanted = clamp(c.asked_mps_q26, has - most, has + most) if slips else c.asked_mps_q26
    record = balancer.control_step(b, p, one_wheel, wanted)

    flags |= b.flags | doubt(c, p, on, left, right)
    c.stop_reason = stopped_by(c, flags, on, blind)
    drives = on and c.stop_reason == 0
    mode = RateLoopMode.OFF if not drives else RateLoopMode.GROUNDED if slips else RateLoopMode.FLYING
    rate_loop_step(
        c.turn, p, "turn", INT32_MAX, p["wheels.integral_max_q30"], c.asked_turnps_q28, c.turn_rate_turnps_q28, mode
    )  # fmt: skip
    if drives:
        flags |= mix(c, p["drive.duty_max_q15"], p["wheels.turn_duty_max_q15"]) | DRIVES
    else:
        c.turn.excess_q24 = 0
        c.turn_duty_q15 = c.duty_left_q15 = c.duty_right_q15 = 0
    c.flags = flags | (LOST if lost else 0) | (SLIPS if slips else 0) | (ACCEL_STILL if blind else 0)
    return (
        *raw, setpoint_speed_q15, c.phase, *record[BALANCER_VALUES], c.asked_mps_q26, c.asked_turnps_q28,
        c.turn_gyro_turnps_q28, c.turn_wheels_turnps_q28, c.turn_bias_turnps_q28, c.turn_rate_turnps_q28,
        *c.turn.words(), c.sum_counts, c.slip_steps, c.phase_steps, c.absent_steps, c.receiver_number, c.age_steps,
        c.apart_mps_q26, c.left_steps, c.right_steps, c.rocked_turnps_q28, c.full_steps, c.still_steps, c.stop_reason,
        c.turn_duty_q15, c.duty_left_q15, c.duty_right_q15, c.flags, c.step,
    )  # fmt: skip


def control_retune(c: WheelsState, old: Params, new: Params) -> None:
    """Other gains from the next step on."""
    balancer.control_retune(c.balancer, old, new)


def control_valid(p: Params) -> bool:
    """As balancer, every word of the declaration within its range, and what the wheels may show."""
    rows = declarations.system("wheels").parameters
    within = all(row["min"] <= p[row["name"]] <= row["max"] for row in rows)
    shown = abs(p["wheels.count_turnps_q28"]) * p["wheels.counts_max"]
    return within and shown <= TURN_MOST and balancer.control_valid(p)


PLAUSIBLE = balancer.PLAUSIBLE._replace(setpoint="asked_mps_q26", setpoint_max=round(0.05 * 2**26), doubts=True)

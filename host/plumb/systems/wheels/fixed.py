"""`wheels` in integers: counts, speed and turn rate to the duties of two motors.

The functions have the names of docs/reference/arithmetic/wheels.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plumb.kernels.fixed import kernels, plausibility
from plumb.kernels.fixed.kernels import Params, PidState
from plumb.kernels.fixed.rate_loop import RateLoopMode, RateLoopState, rate_loop_step
from plumb.kernels.integers import INT32_MAX, Integer, clamp, mul, select, wrap_i32
from plumb.spec import declarations
from plumb.systems.balancer import fixed as balancer

STOPPED, RIDDEN, STOPPING = range(3)
STOP_FALLEN, STOP_RIDER, STOP_SENSORS = 32, 64, 128
GYRO, ACCEL_X, ACCEL_Z, GYRO_UP, LEFT, RIGHT, RIDER = range(7)
ROLL, PITCH, YAW, SWITCHES, RECEIVER = range(9, 14)
MOTORS_ON = 1
FULL_Q15, STEPS_MOST = 32767, 65535
CLOSED_TAKES = 4
"""Open steps that a closed step of the rider's switch outweighs."""
BIAS_MOST = 1 << 27
"""turn/s Q28."""
TURN_MOST = 4 << 28
ACCEL_CLAMPED, WHEEL_CLAMPED, GYRO_UP_CLAMPED, FALLEN = 3 << 1, 1 << 4, 1 << 6, 1 << 7
DRIVES, TURN_LIMITED, SLIPS, LOST = 1 << 8, 1 << 9, 1 << 10, 1 << 11
ENCODERS, LIFTED, ACCEL_STILL = 1 << 12, 1 << 13, 1 << 14
APART_MOST = 8 << 26
"""m/s Q26."""
UP_LEAST = 1 << 25
"""g Q26: half."""
ROCKED_MOST = 1 << 30
"""turn/s Q28."""
BALANCER_INPUTS = 7
"""Words of a record of balancer before its first value: six counts and the setpoint."""
BALANCER_UP, BALANCER_VELOCITY, BALANCER_MEASURED, BALANCER_TILT = 9, 11, 14, 25
BALANCER_RATE, BALANCER_DUTY = 27, -3
"""Places in such a record."""
VALUES = slice(BALANCER_INPUTS, -2)
"""From the calibrated gyro to the duty."""


@dataclass(slots=True)
class ControlState:
    balancer: balancer.ControlState
    turn: RateLoopState
    counts: tuple[Integer, Integer]
    phase: Integer
    tilt: Integer
    bias: Integer
    sum: Integer
    velocity: Integer
    apart: Integer
    since: tuple[Integer, Integer]
    rocked: Integer
    full: Integer
    still: Integer
    acceleration: tuple[Integer, Integer]
    up: Integer
    stop_reason: Integer
    flags: Integer
    slip: Integer
    absent: Integer
    phase_steps: Integer
    number: Integer
    age: Integer
    step: Integer


def control_init(p: Params) -> ControlState:
    zero = 0 * p["wheels.lost_steps"]
    loop = RateLoopState(zero, zero, zero, zero)
    return ControlState(
        balancer.control_init(p), loop, (zero, zero), phase=zero + STOPPED, tilt=zero, bias=zero, sum=zero,
        velocity=zero, apart=zero, since=(zero, zero), rocked=zero, full=zero, still=zero,
        acceleration=(zero, zero), up=zero,
        stop_reason=zero, flags=zero, slip=zero, absent=p["wheels.absent_steps"] + zero, phase_steps=zero, number=zero,
        age=zero, step=zero,
    )  # fmt: skip


def wrap_i16(x: Integer) -> Integer:
    return ((x + 0x8000) & 0xFFFF) - 0x8000


def by_stick(stick: Integer, most: Integer) -> Integer:
    """Share of the most that a stick, Q15, asks for, in the format of the most."""
    return 2 * mul(clamp(stick, -FULL_Q15, FULL_Q15) << 16, most)


def listen(c: ControlState, p: Params, receiver: Integer) -> Integer:
    """Whether the receiver is lost."""
    number = receiver & 255
    same = (number != 0) & (number == c.number)
    c.age = select(same, clamp(c.age + 1, 0, STEPS_MOST), 0 * c.age)
    c.number = number
    return (number != 0) & (((receiver & 256) != 0) | (c.age >= p["wheels.lost_steps"]))


def decide(c: ControlState, p: Params, present: Integer, blind: Integer, on: Integer) -> None:
    """The phase of this step, from the tilt of the step before."""
    before = c.phase
    full = p["wheels.absent_steps"]
    c.absent = select(present, clamp(c.absent - CLOSED_TAKES, 0, STEPS_MOST), clamp(c.absent + 1, 0, full))
    c.phase_steps = clamp(c.phase_steps + 1, 0, STEPS_MOST)
    rides = present & (c.absent == 0) & (blind == 0)
    takes = rides & (abs(c.tilt) <= p["wheels.up_turn_q32"])
    gone = (c.absent >= full) | (blind != 0)
    over = c.phase_steps > p["wheels.stopping_steps"]
    left = select(rides, 0 * before + RIDDEN, select(over, 0 * before + STOPPED, before))
    driven = select(before == RIDDEN, select(gone, 0 * before + STOPPING, before), left)
    ridden = select(before == STOPPED, select(takes, 0 * before + RIDDEN, before), driven)
    c.phase = select(on, ridden, 0 * before + STOPPED)
    c.phase_steps = select(c.phase == before, c.phase_steps, 0 * c.phase_steps)


def turning(
    c: ControlState, p: Params, difference: Integer, count: Integer
) -> tuple[Integer, Integer, Integer, Integer]:
    """Turn rates of the gyro and of the wheels; the rate less bias; flags."""
    gyro, clamped = kernels.calibrate(count, p, "gyro")
    used = clamp(difference, -p["wheels.counts_max"], p["wheels.counts_max"])
    rolled = used * p["wheels.count_turnps_q28"]
    apart = (gyro >> 1) - (rolled >> 1) - (c.bias >> 1)
    doubt = p["wheels.doubt_turnps_q28"] >> 1
    seen = abs(apart) > p["wheels.slip_turnps_q28"] >> 1
    c.slip = select(seen, p["wheels.slip_hold"] + 0 * c.slip, c.slip - select(c.slip != 0, 1, 0))
    followed = c.bias + 4 * mul(clamp(apart, -doubt, doubt), p["wheels.bias_alpha_q31"])
    c.bias = select(c.slip == 0, clamp(followed, -BIAS_MOST, BIAS_MOST), c.bias)
    flags = clamped * GYRO_UP_CLAMPED | select(used != difference, WHEEL_CLAMPED, 0)
    return gyro, rolled, gyro - c.bias, flags


def is_odd(c: ControlState) -> Integer:
    """Whether the accelerometer of the step before was outside its range, or, while it drives and so is upright,
    without half of gravity."""
    return ((c.flags & ACCEL_CLAMPED) != 0) | ((c.phase != STOPPED) & (c.up < UP_LEAST))


def in_a_row(steps: Integer, again: Integer, most: Integer) -> Integer:
    """Steps in a row, up to the most that is asked for."""
    return select(again, clamp(steps + 1, 0, most), 0 * steps)


def still(c: ControlState, p: Params, raw: Sequence[Integer], odd: Integer, first: Integer) -> Integer:
    """Whether the accelerometer has repeated its counts, or made none that it can mean, for too long."""
    x, z = c.acceleration
    c.acceleration = raw[ACCEL_X], raw[ACCEL_Z]
    repeats = (first == 0) & ((raw[ACCEL_X] == x) | (raw[ACCEL_Z] == z))
    c.still = in_a_row(c.still, repeats | odd, p["wheels.still_steps"])
    return c.still >= p["wheels.still_steps"]


def both(c: ControlState, p: Params, left: Integer, right: Integer, rate: Integer) -> Integer:
    """Counts of both wheels in a step. While one slips, those of one and of the turn that the gyro feels: of the wheel
    that is nearer to the speed felt; of the one that counts where the other one does not."""
    most, edge = p["wheel.edges_max"], p["wheel.edge_mps_q26"]
    turned = (mul(rate, p["wheels.turn_counts_q36"]) + 8) >> 4
    by_left, by_right = 2 * left + turned, 2 * right - turned
    felt = c.velocity + c.apart
    beside = [abs(wrap_i32(clamp(counts, -most, most) * edge - felt)) for counts in (by_left, by_right)]
    nearer = select(beside[0] <= beside[1], by_left, by_right)
    dead_left, dead_right = (since >= p["wheels.dead_steps"] for since in c.since)
    counting = select(dead_right, by_left, by_right)
    return select(dead_left != dead_right, counting, select(c.slip != 0, nearer, left + right))


def since_count(steps: Integer, counts: Integer, most: Integer) -> Integer:
    """Steps since the last one with a count of a wheel, that one counted; 0: none since it drives."""
    return select(counts != 0, 0 * steps + 1, select(steps != 0, clamp(steps + 1, 0, most), steps))


def doubt(
    c: ControlState, p: Params, record: Sequence[Integer], wheels: tuple[Integer, Integer], on: Integer
) -> Integer:
    """Flags of encoders without counts and of wheels in the air, from what is felt. record: of balancer."""
    drives, duty = on & (c.stop_reason == 0), record[BALANCER_DUTY]
    counts, c.velocity = wheels[0] | wheels[1], record[BALANCER_VELOCITY]
    felt = wrap_i32(record[BALANCER_MEASURED] - c.tilt)
    faded = c.apart - 2 * mul(c.apart, p["wheels.apart_alpha_q31"])
    apart = clamp(faded - mul(felt, p["wheels.felt_mps_q26"]), -APART_MOST, APART_MOST)
    c.apart = select(drives, apart, 0 * apart)
    left, right = (
        select(drives, since_count(steps, one, p["wheels.dead_steps"]), 0 * steps)
        for steps, one in zip(c.since, wheels, strict=True)
    )
    c.since = left, right
    rocked = clamp(c.rocked + abs(record[BALANCER_RATE]), 0, ROCKED_MOST)
    c.rocked = select(drives & (counts == 0), rocked, 0 * rocked)
    full = drives & (counts != 0) & (abs(duty) >= p["drive.duty_max_q15"] - (p["drive.duty_max_q15"] >> 3))
    c.full = in_a_row(c.full, full, p["wheels.full_steps"])
    dead = (left >= p["wheels.dead_steps"]) & (right >= p["wheels.dead_steps"])
    rocks = dead & (c.rocked > p["wheels.rocked_turnps_q28"])
    moves = drives & ((left | right) == 0) & (abs(c.velocity + c.apart) > p["wheels.apart_max_mps_q26"])
    kept = select(on, c.flags & (ENCODERS | LIFTED), 0 * c.flags)
    return kept | select(rocks | moves, ENCODERS, 0) | select(c.full >= p["wheels.full_steps"], LIFTED, 0)


def stopped_by(c: ControlState, flags: Integer, on: Integer, blind: Integer) -> Integer:
    """Why the motors are off."""
    idle = select(blind, STOP_SENSORS, STOP_RIDER)
    reason = select(on & (c.phase == STOPPED), idle, 0 * idle) | select((flags & FALLEN) != 0, STOP_FALLEN, 0)
    return reason | select(on & ((flags & (ENCODERS | LIFTED)) != 0), STOP_SENSORS, 0)


def at_rest(pid: PidState, stopped: Integer) -> PidState:
    """The controller, or where the vehicle is stopped one that begins."""
    return PidState(*(select(stopped, 0 * word, word) for word in (getattr(pid, name) for name in PidState.__slots__)))


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    first, c.step = c.step == 0, c.step + 1
    counts = raw[LEFT], raw[RIGHT]
    left, right = (select(first, 0 * now, wrap_i16(now - last)) for now, last in zip(counts, c.counts, strict=True))
    c.counts = counts
    lost = listen(c, p, raw[RECEIVER])
    on = (c.number == 0) | ((raw[SWITCHES] & MOTORS_ON) != 0)
    odd = is_odd(c)
    blind = still(c, p, raw, odd, first)
    decide(c, p, raw[RIDER] > 0, blind, on)
    obeys = (c.phase == RIDDEN) & (lost == 0)
    speed = select(c.number != 0, raw[PITCH], clamp(setpoint, -FULL_Q15, FULL_Q15))
    none = 0 * c.phase
    asked = select(obeys, by_stick(speed, p["drive.speed_max_mps_q26"]), none)
    asked_turn = select(obeys, by_stick(raw[YAW] - raw[ROLL], p["wheels.turn_max_turnps_q28"]), none)

    stopped = c.phase == STOPPED
    b = c.balancer
    b.speed, b.pid = at_rest(b.speed, stopped), at_rest(b.pid, stopped)
    gyro, rolled, rate, turn_flags = turning(c, p, right - left, raw[GYRO_UP])
    slips = c.slip != 0
    c.sum = both(c, p, left, right, rate)
    zero = 0 * raw[LEFT]
    one_wheel = (raw[GYRO], raw[ACCEL_X], raw[ACCEL_Z], wrap_i16(b.hall + c.sum), zero, zero)
    b.blind = bool(blind | odd)
    has, most = b.wheel.velocity_mps_q26, p["wheels.slip_mps_q26"]
    record = balancer.control_step(b, p, one_wheel, select(slips, clamp(asked, has - most, has + most), asked))
    c.up, c.tilt, duty = record[BALANCER_UP], record[BALANCER_TILT], record[BALANCER_DUTY]

    flags = record[-2] | turn_flags | doubt(c, p, record, (left, right), on)
    c.stop_reason = stop_reason = stopped_by(c, flags, on, blind)
    drives = on & (stop_reason == 0)
    mode = (RateLoopMode.GROUNDED if slips else RateLoopMode.FLYING) if drives else RateLoopMode.OFF
    rate_loop_step(c.turn, p, "turn", INT32_MAX, p["wheels.integral_max_q30"], asked_turn, rate, mode)
    full = p["drive.duty_max_q15"]
    duty = clamp(select(slips, 2 * duty, duty), -full, full)
    room = full - abs(duty)
    room = select(room < p["wheels.turn_duty_max_q15"], room, p["wheels.turn_duty_max_q15"])
    room = select(slips, 0 * room, room)
    wanted = c.turn.demand_q24 >> 9
    turn = clamp(wanted, -room, room)
    c.turn.excess_q24 = select(drives, (wanted - turn) << 9, 0 * wanted)
    duties = select(drives, duty - turn, 0 * duty), select(drives, duty + turn, 0 * duty)
    flags = flags | select(drives, DRIVES, 0) | select(drives & (wanted != turn), TURN_LIMITED, 0)
    flags = flags | select(slips, SLIPS, 0) | select(lost, LOST, 0) | select(blind, ACCEL_STILL, 0)
    c.flags = flags
    return (
        *raw, setpoint, c.phase, *record[VALUES], asked, asked_turn, gyro, rolled, c.bias, rate, *c.turn.words(),
        c.sum, c.slip, c.phase_steps, c.absent, c.number, c.age, c.apart, *c.since, c.rocked, c.full, c.still,
        stop_reason, select(drives, turn, 0 * turn), *duties, flags, c.step,
    )  # fmt: skip


def control_retune(c: ControlState, old: Params, new: Params) -> None:
    """Other gains from the next step on."""
    balancer.control_retune(c.balancer, old, new)


def control_valid(p: Params) -> bool:
    """As balancer, every word of the declaration within its range, and what the wheels may show."""
    rows = declarations.system("wheels").parameters
    within = all(row["min"] <= int(p[row["name"]]) <= row["max"] for row in rows)
    shown = abs(int(p["wheels.count_turnps_q28"])) * int(p["wheels.counts_max"])
    return within and shown <= TURN_MOST and balancer.control_valid(p)


PLAUSIBLE = plausibility.Bounds(
    setpoint="asked_mps_q26",
    accel=("accel_x_g_q26", "accel_z_g_q26"),
    accel_g2_q20=(round(0.4**2 * 2**20), round(1.8**2 * 2**20)),
    rest_g2_q20=(round(0.9**2 * 2**20), round(1.1**2 * 2**20)),
    rest_turnps_q28=round(10.0 / 360.0 * 2**28),
    uneven_turn_q32=round(30.0 / 360.0 * 2**32),
    ready_turn_q32=round(10.0 / 360.0 * 2**32),
    setpoint_max=round(0.05 * 2**26),
)

"""What the step of `wheels` does not believe, in integers: an accelerometer that stands still, encoders that are dead,
a wheel that slips, and wheels in the air.

The functions have the names of firmware/systems/wheels_doubt.c, without plumb_wheels_.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import clamp, mulhi_i32, wrap_i32
from plumb.systems.wheels.fixed_state import (
    ACCEL_CLAMPED,
    ENCODERS,
    FALLEN,
    LIFTED,
    STOP_FALLEN,
    STOP_RIDER,
    STOP_SENSORS,
    STOPPED,
    WheelsState,
)

UP_LEAST, APART_MOST, ROCKED_MOST = 1 << 25, 8 << 26, 1 << 30
"""g Q26: half; m/s Q26; turn/s Q28."""


def is_odd(c: WheelsState) -> bool:
    """Whether the accelerometer of the step before says nothing of the tilt: outside its range, or, while it drives and
    so is upright, without half of gravity."""
    return c.flags & ACCEL_CLAMPED != 0 or (c.phase != STOPPED and c.balancer.accel_z_g_q26 < UP_LEAST)


def in_a_row(steps: int, again: bool, most: int) -> int:
    """Steps in a row, up to the most that is asked for."""
    return min(steps + 1, most) if again else 0


def since_count(steps: int, counts: int, most: int) -> int:
    """Steps since the last one with a count of a wheel, that one counted; 0: none since it drives."""
    if counts != 0:
        return 1
    return min(steps + 1, most) if steps != 0 else 0


def doubt(c: WheelsState, p: Params, on: bool, left: int, right: int) -> int:
    """Flags of encoders without counts and of wheels in the air, from what accelerometer and wheels say of each
    other."""
    b = c.balancer
    kept = c.flags & (ENCODERS | LIFTED) if on else 0
    if not on or c.stop_reason != 0:
        c.apart_mps_q26 = 0
        c.left_steps = c.right_steps = c.rocked_turnps_q28 = c.full_steps = 0
        return kept
    felt = wrap_i32(b.tilt_measured_turn_q32 - b.tilt_turn_q32)
    faded = c.apart_mps_q26 - 2 * mulhi_i32(c.apart_mps_q26, p["wheels.apart_alpha_q31"])
    counts = left != 0 or right != 0
    c.apart_mps_q26 = clamp(faded - mulhi_i32(felt, p["wheels.felt_mps_q26"]), -APART_MOST, APART_MOST)
    dead = p["wheels.dead_steps"]
    c.left_steps = since_count(c.left_steps, left, dead)
    c.right_steps = since_count(c.right_steps, right, dead)
    nearly = p["drive.duty_max_q15"] - (p["drive.duty_max_q15"] >> 3)
    c.full_steps = in_a_row(c.full_steps, counts and abs(b.duty_q15) >= nearly, p["wheels.full_steps"])
    if c.full_steps >= p["wheels.full_steps"]:
        kept |= LIFTED
    if counts:
        c.rocked_turnps_q28 = 0
        return kept
    c.rocked_turnps_q28 = min(c.rocked_turnps_q28 + abs(b.rate_corrected_turnps_q28), ROCKED_MOST)
    rocks = min(c.left_steps, c.right_steps) >= dead and c.rocked_turnps_q28 > p["wheels.rocked_turnps_q28"]
    never = c.left_steps == 0 and c.right_steps == 0
    moves = never and abs(b.wheel.velocity_mps_q26 + c.apart_mps_q26) > p["wheels.apart_max_mps_q26"]
    return kept | (ENCODERS if rocks or moves else 0)


def stopped_by(c: WheelsState, flags: int, on: bool, blind: bool) -> int:
    """Why the motors are off."""
    reason = STOP_FALLEN if flags & FALLEN else 0
    if on and c.phase == STOPPED:
        reason |= STOP_SENSORS if blind else STOP_RIDER
    if on and flags & (ENCODERS | LIFTED):
        reason |= STOP_SENSORS
    return reason


def residual(p: Params, counts: int, felt: int) -> int:
    """Distance of the speed of these counts from the speed that is felt, m/s Q26."""
    speed = clamp(counts, -p["wheel.edges_max"], p["wheel.edges_max"]) * p["wheel.edge_mps_q26"]
    return abs(wrap_i32(speed - felt))


def both(c: WheelsState, p: Params, left: int, right: int) -> int:
    """Counts of both wheels in this step. While one slips, those of one of them and of the turn that the gyro feels: of
    the wheel that is nearer to the speed felt; of the one that counts where the other one does not."""
    dead = p["wheels.dead_steps"]
    one = (c.left_steps >= dead) != (c.right_steps >= dead)
    if c.slip_steps == 0 and not one:
        return left + right
    turned = (mulhi_i32(c.turn_rate_turnps_q28, p["wheels.turn_counts_q36"]) + 8) >> 4
    by_left, by_right = 2 * left + turned, 2 * right - turned
    felt = c.balancer.wheel.velocity_mps_q26 + c.apart_mps_q26
    if one:
        return by_left if c.right_steps >= dead else by_right
    return by_left if residual(p, by_left, felt) <= residual(p, by_right, felt) else by_right

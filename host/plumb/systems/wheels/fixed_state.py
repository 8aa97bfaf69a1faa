"""State of `wheels` in integers, its inputs, phases and flags."""

from __future__ import annotations

from dataclasses import dataclass, field

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.rate_loop import RateLoopState
from plumb.systems.balancer import fixed as balancer

STOPPED, RIDDEN, STOPPING = range(3)
STOP_FALLEN, STOP_RIDER, STOP_SENSORS = 32, 64, 128
GYRO, ACCEL_X, ACCEL_Z, GYRO_UP, LEFT, RIGHT, RIDER = range(7)
ROLL, PITCH, YAW, SWITCHES, RECEIVER = range(9, 14)
MOTORS_ON = 1
CLOSED_TAKES = 4
"""Open steps that a closed step of the rider's switch outweighs."""
ACCEL_CLAMPED, WHEEL_CLAMPED, GYRO_UP_CLAMPED, FALLEN = 3 << 1, 1 << 4, 1 << 6, 1 << 7
DRIVES, TURN_LIMITED, SLIPS, LOST = 1 << 8, 1 << 9, 1 << 10, 1 << 11
ENCODERS, LIFTED, ACCEL_STILL = 1 << 12, 1 << 13, 1 << 14


@dataclass(slots=True)
class WheelsState:
    """raw: inputs of the step before."""

    balancer: balancer.BalancerState
    raw: tuple[int, ...] = (0,) * 15
    phase: int = STOPPED
    asked_mps_q26: int = 0
    asked_turnps_q28: int = 0
    turn_gyro_turnps_q28: int = 0
    turn_wheels_turnps_q28: int = 0
    turn_bias_turnps_q28: int = 0
    turn_rate_turnps_q28: int = 0
    turn: RateLoopState = field(default_factory=RateLoopState)
    sum_counts: int = 0
    slip_steps: int = 0
    phase_steps: int = 0
    absent_steps: int = 0
    receiver_number: int = 0
    age_steps: int = 0
    apart_mps_q26: int = 0
    left_steps: int = 0
    right_steps: int = 0
    rocked_turnps_q28: int = 0
    full_steps: int = 0
    still_steps: int = 0
    stop_reason: int = 0
    turn_duty_q15: int = 0
    duty_left_q15: int = 0
    duty_right_q15: int = 0
    flags: int = 0
    step: int = 0


def control_init(p: Params) -> WheelsState:
    return WheelsState(balancer.control_init(p), absent_steps=p["wheels.absent_steps"])

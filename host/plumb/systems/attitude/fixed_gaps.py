"""What `attitude` makes of samples that are missing or at a limit, in integers.

The functions have the names of docs/reference/arithmetic/attitude.md.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, mul, select
from plumb.systems.attitude.fixed_covariance import AXES, VARIANCE_MAX_Q32
from plumb.systems.attitude.fixed_state import ACCEL_CLIPPED, GYRO_CLIPPED, ControlState, in_runs
from plumb.systems.attitude.fixed_turns import turn_body

LONGEST_RUN = 255
BRIDGED_TURN_MAX_Q32, BRIDGED_ACCEL_MAX_Q20, BRIDGED_MAX_Q18 = 1846835936, 1258291200, 550502400
VELOCITY_ADDED_MAX_Q26 = 13421773
SIXTH_Q32 = 715827883
I32 = (1 << 31) - 1


def squares(values: list[Integer]) -> Integer:
    return sum(mul(value, value) for value in values)


def bridge(c: ControlState, p: Params) -> None:
    """A sample after a gap: the turn, the acceleration (g Q20, body axes) and the variances that the gap has hidden."""
    in_runs(c, p, c.started != 0, bridge_started)
    c.gap = 0 * c.gap


def bridge_started(c: ControlState, p: Params) -> None:
    n = c.gap
    by = [(c.half[i] >> 1) - 3 * c.half_sixth[i] for i in AXES]
    by_accel = [c.accel[i] - 6 * c.accel_sixth[i] for i in AXES]
    turn = [clamp((value * n) >> 1, -BRIDGED_TURN_MAX_Q32, BRIDGED_TURN_MAX_Q32) for value in by]
    c.bridged_force = [clamp((value * n) >> 6, -BRIDGED_ACCEL_MAX_Q20, BRIDGED_ACCEL_MAX_Q20) for value in by_accel]
    c.tilt_added = clamp(c.tilt_added + 2 * n * n * squares(by), 0, VARIANCE_MAX_Q32)
    dt = p["attitude.dt_s_q33"]
    gap_s2 = (n * n * ((dt * dt) >> 32)) >> 8
    c.velocity_added = clamp(c.velocity_added + ((gap_s2 * squares(by_accel)) >> 21), 0, VELOCITY_ADDED_MAX_Q26)
    for _ in range(2):
        turn_body(c, turn)


def unseen(run: Integer, slope: Integer, now: Integer, clipped: Integer) -> tuple[Integer, Integer, Integer]:
    """The run and the slope after this sample, and n^4 slope where the run has ended."""
    begins, ends = clipped & (run == 0), (clipped == 0) & (run != 0)
    slope = select(begins | (ends & (now > slope)), now, slope)
    after = select(clipped, clamp(run + 1, 0, LONGEST_RUN), 0 * run)
    return after, slope, select(ends, run * run * run * run * slope, 0 * run)


def count_clipped(c: ControlState, p: Params) -> None:
    """Counts samples at the limits, and adds what they have hidden when they end."""
    in_runs(c, p, c.started != 0, count_started)


def count_started(c: ControlState, p: Params) -> None:
    turn = [mul(c.half[i], SIXTH_Q32) - c.half_sixth[i] for i in AXES]
    accel = [mul(c.accel[i], SIXTH_Q32) - c.accel_sixth[i] for i in AXES]
    gyro_clipped, accel_clipped = (c.flags & GYRO_CLIPPED) != 0, (c.flags & ACCEL_CLIPPED) != 0
    c.gyro_run, c.gyro_slope, turned = unseen(c.gyro_run, c.gyro_slope, squares(turn), gyro_clipped)
    c.accel_run, c.accel_slope, forced = unseen(c.accel_run, c.accel_slope, squares(accel), accel_clipped)
    c.tilt_added = clamp(c.tilt_added + 4 * clamp(turned, 0, VARIANCE_MAX_Q32) // 3, 0, VARIANCE_MAX_Q32)
    dt = p["attitude.dt_s_q33"]
    square = (clamp(forced >> 10, 0, 1 << 40) * ((dt * dt) >> 32)) >> 16
    third = clamp(square, 0, 3 * VELOCITY_ADDED_MAX_Q26) // 3
    c.velocity_added = clamp(c.velocity_added + third, 0, VELOCITY_ADDED_MAX_Q26)

"""State of `attitude` in integers, and how it starts and forgets.

The functions and words have the names of firmware/systems/attitude.c, without plumb.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from plumb.kernels.fixed import error_filter
from plumb.kernels.fixed.error_filter import ErrorFilter
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.quaternion import ONE_Q30

GYRO_CLIPPED, ACCEL_CLIPPED, MISSING, ALIGNING, REST, FALLING, ACCELERATING, UNSURE, RESTARTED, AIRBORNE = (
    1 << bit for bit in range(10)
)
SLICE_NONE, SLICE_CORRECT, SLICE_JUDGE, SLICE_TILT_X, SLICE_TILT_Y, SLICE_MEASURE = range(6)
LANDED_BLOCKS, MAYBE_LANDED_BLOCKS = 67, 8
VELOCITY_ADDED_Q26, LONGEST_RUN, HALF_LIMIT_Q30, SIXTH_Q32 = 13421773, 255, 461708984, 715827883
VELOCITY_Q28 = 1 << 30
"""A velocity saturates at +-4 g s."""


def zeros(count: int) -> Callable[[], list[int]]:
    return lambda: [0] * count


def rows() -> list[list[int]]:
    return [[0, 0, 0], [0, 0, 0]]


@dataclass(slots=True)
class AttitudeState:
    """Words of the record, then what else the next step needs."""

    rate_turnps_q28: list[int] = field(default_factory=zeros(3))
    accel_g_q25: list[int] = field(default_factory=zeros(3))
    attitude: list[int] = field(default_factory=lambda: [ONE_Q30, 0, 0, 0])
    up_q30: list[int] = field(default_factory=lambda: [0, 0, ONE_Q30])
    bias_turnps_q32: list[int] = field(default_factory=zeros(3))
    scale_q32: list[int] = field(default_factory=zeros(3))
    velocity_gs_q28: list[int] = field(default_factory=zeros(2))
    velocity_square_g2s2_q24: int = 0
    velocity_variance_g2s2_q26: int = 0
    tilt_variance_rad2_q32: int = 0
    block_step: int = 0
    missing_steps: int = 0
    flags: int = 0
    step: int = 0

    thrust_q15: int = 0
    errors: ErrorFilter = field(default_factory=ErrorFilter)
    rows_sum_q22: list[list[int]] = field(default_factory=rows)
    turned_sum_q28: list[list[int]] = field(default_factory=rows)
    force_sum_q18: list[int] = field(default_factory=zeros(3))
    force_before_q18: list[int] = field(default_factory=zeros(3))
    half_sum_q32: list[int] = field(default_factory=zeros(3))
    half_mean_q32: list[int] = field(default_factory=zeros(3))
    energy_q24: int = 0
    half_sixth_q32: list[int] = field(default_factory=zeros(3))
    accel_sixth_q25: list[int] = field(default_factory=zeros(3))
    tilt_added_q32: int = 0
    velocity_added_q26: int = 0
    gyro_slope_q32: int = 0
    accel_slope_q18: int = 0
    thrust_sum_q18: list[int] = field(default_factory=zeros(2))
    measured_gs_q28: list[int] = field(default_factory=zeros(2))
    travel_gs_q28: list[int] = field(default_factory=zeros(2))
    corrected_rad_q26: list[int] = field(default_factory=zeros(2))
    travel_excess_q24: int = 0
    rise_g_q18: int = 0
    turning_rad_q26: int = 0
    block_flags: int = 0
    slice: int = SLICE_NONE
    still_blocks: int = 0
    aligned_blocks: int = 0
    gap_steps: int = 0
    gyro_clipped_steps: int = 0
    accel_clipped_steps: int = 0
    moved: bool = False
    started: bool = False
    vehicle: bool = False
    airborne: bool = False
    carried_blocks: int = LANDED_BLOCKS
    thrust_blocks: int = 0
    held_blocks: int = 0
    flown_blocks: int = 0
    hover_q15: int = 0
    weight_g_q18: int = 1 << 18
    climb_gs_q28: int = 0


def control_init(p: Params) -> AttitudeState:
    c = AttitudeState(hover_q15=p["attitude.aid_hover_q15"])
    start(c, p)
    return c


def clear_sums(c: AttitudeState) -> None:
    """At the start of a block."""
    c.rows_sum_q22, c.turned_sum_q28 = rows(), rows()
    c.force_sum_q18, c.half_sum_q32 = [0, 0, 0], [0, 0, 0]
    c.tilt_added_q32 = c.velocity_added_q26 = 0
    c.energy_q24 = 0
    c.thrust_sum_q18 = [0, 0]
    c.moved = False


def forget(c: AttitudeState, p: Params, bias: int, tilt: int) -> None:
    """Forget the velocity, and how well the errors are known: their variances become those of a start, of bias and tilt
    these."""
    c.velocity_gs_q28 = [0, 0]
    c.velocity_square_g2s2_q24 = 0
    c.errors = error_filter.start(bias, p["attitude.start_scale"], tilt, p["attitude.start_speed"])
    c.tilt_variance_rad2_q32 = 2 * p["attitude.start_tilt"]
    c.block_flags |= UNSURE
    c.held_blocks = 0
    c.travel_gs_q28 = [0, 0]
    c.travel_excess_q24 = c.rise_g_q18 = 0
    c.corrected_rad_q26 = [0, 0]


def start(c: AttitudeState, p: Params) -> None:
    """Restart the filter as before the first sample; the heading stays."""
    c.bias_turnps_q32, c.scale_q32 = [0, 0, 0], [0, 0, 0]
    c.block_flags = ALIGNING
    forget(c, p, p["attitude.start_bias"], p["attitude.start_tilt"])
    c.slice = SLICE_NONE
    c.still_blocks = c.aligned_blocks = 0
    clear_sums(c)

"""State of `attitude` in integers, and parts of the step that only some runs do."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.integers import Integer

GYRO_CLIPPED, ACCEL_CLIPPED, MISSING, ALIGNING, REST, FALLING, ACCELERATING, UNSURE, RESTARTED, AIRBORNE = (
    1 << bit for bit in range(10)
)
STATES = range(10)
BIAS, SCALE, TILT, VELOCITY = 0, 3, 6, 8
CELL = [[max(i, j) * (max(i, j) + 1) // 2 + min(i, j) for j in STATES] for i in STATES]
"""Where the covariance of states i and j is."""
LANDED_BLOCKS, ONE_G_Q18 = 67, 1 << 18
JUDGED = UNSURE | ACCELERATING
"""Flags that the first slice after a block sets."""


def zeros(count: int) -> Callable[[], list[Integer]]:
    return lambda: [0] * count


@dataclass(slots=True)
class ControlState:
    """Words of the record, then what else the next step needs; half and bridged_force are of the step under way."""

    rate: list[Integer] = field(default_factory=zeros(3))
    accel: list[Integer] = field(default_factory=zeros(3))
    attitude: list[Integer] = field(default_factory=zeros(4))
    up: list[Integer] = field(default_factory=zeros(3))
    bias: list[Integer] = field(default_factory=zeros(3))
    scale: list[Integer] = field(default_factory=zeros(3))
    velocity: list[Integer] = field(default_factory=zeros(2))
    velocity_square: Integer = 0
    velocity_variance: Integer = 0
    tilt_variance: Integer = 0
    block_step: Integer = 0
    missing_steps: Integer = 0
    step: Integer = 0

    covariance: list[Integer] = field(default_factory=zeros(55))
    correction: list[Integer] = field(default_factory=zeros(10))
    gain: list[Integer] = field(default_factory=zeros(10))
    row: list[Integer] = field(default_factory=zeros(10))
    coupling: list[Integer] = field(default_factory=zeros(12))
    half_lever: Integer = 0
    tilt_growth: Integer = 0
    velocity_growth: Integer = 0
    tilt_added: Integer = 0
    velocity_added: Integer = 0
    gyro_slope: Integer = 0
    accel_slope: Integer = 0
    thrust_sum: list[Integer] = field(default_factory=zeros(2))
    measured: list[Integer] = field(default_factory=zeros(2))
    thrust: Integer = 0
    airborne: Integer = 0
    vehicle: Integer = 0
    carried_blocks: Integer = 0
    thrust_blocks: Integer = 0
    flown_blocks: Integer = 0
    hover: Integer = 0
    weight: Integer = 0
    climb: Integer = 0
    travel: list[Integer] = field(default_factory=zeros(2))
    corrected: list[Integer] = field(default_factory=zeros(2))
    travel_excess: Integer = 0
    rise: Integer = 0
    turning: Integer = 0
    held_blocks: Integer = 0
    rows_sum: list[Integer] = field(default_factory=zeros(6))
    turned_sum: list[Integer] = field(default_factory=zeros(6))
    force_sum: list[Integer] = field(default_factory=zeros(3))
    force_before: list[Integer] = field(default_factory=zeros(3))
    half_sum: list[Integer] = field(default_factory=zeros(3))
    half_mean: list[Integer] = field(default_factory=zeros(3))
    energy: Integer = 0
    half: list[Integer] = field(default_factory=zeros(3))
    bridged_force: list[Integer] = field(default_factory=zeros(3))
    flags: Integer = 0
    half_sixth: list[Integer] = field(default_factory=zeros(3))
    accel_sixth: list[Integer] = field(default_factory=zeros(3))
    block_flags: Integer = 0
    slice: Integer = 0
    still_blocks: Integer = 0
    aligned_blocks: Integer = 0
    gap: Integer = 0
    gyro_run: Integer = 0
    accel_run: Integer = 0
    moved: Integer = 0
    started: Integer = 0


NAMES = tuple(one.name for one in fields(ControlState))
SUMS = (
    "rows_sum", "turned_sum", "force_sum", "thrust_sum", "half_sum", "block_step", "energy", "moved", "tilt_added",
    "velocity_added",
)  # fmt: skip
KEPT = (
    "rate", "accel", "attitude", "up", "velocity_variance", "block_step", "missing_steps", "step", "half", "flags",
    "bridged_force", "gain", "row", "coupling", "half_lever", "tilt_growth", "velocity_growth", "force_before",
    "measured", "thrust", "airborne", "vehicle", "carried_blocks", "thrust_blocks", "flown_blocks", "hover", "weight",
    "climb", "half_mean", "half_sixth", "accel_sixth", "started", "gap",
    "gyro_run", "accel_run", "gyro_slope", "accel_slope", "turning",
)  # fmt: skip
"""What a start leaves as it was."""
FORGOTTEN = (
    "velocity", "velocity_square", "covariance", "correction", "gain", "row", "coupling", "half_lever", "tilt_growth",
    "velocity_growth", "held_blocks", "travel", "travel_excess", "rise", "corrected",
)  # fmt: skip


def clear(c: ControlState, names: Iterable[str], zero: Integer) -> None:
    """Set the named parts of the state to zero."""
    for name in names:
        value = getattr(c, name)
        setattr(c, name, [zero] * len(value) if isinstance(value, list) else zero)


def in_runs(c: ControlState, p: Params, where: Integer, part: Callable[[ControlState, Params], None]) -> None:
    """Do `part` with the state if the condition holds."""
    if where:
        part(c, p)


def control_init(p: Params) -> ControlState:
    c, zero = ControlState(), 0 * p["attitude.block_steps"]
    clear(c, NAMES, zero)
    c.attitude[0] = c.up[2] = zero + ONE_Q30
    c.carried_blocks, c.weight, c.hover = zero + LANDED_BLOCKS, zero + ONE_G_Q18, zero + p["attitude.aid_hover_q15"]
    start(c, p)
    return c


def start(c: ControlState, p: Params) -> None:
    zero = 0 * p["attitude.block_steps"]
    clear(c, [name for name in NAMES if name not in KEPT], zero)
    c.block_flags = zero + ALIGNING
    forget(c, p, p["attitude.start_bias"], p["attitude.start_tilt"])


def forget(c: ControlState, p: Params, bias: Integer, tilt: Integer) -> None:
    """The variances of a start, of bias and tilt these; the velocity is 0."""
    clear(c, FORGOTTEN, 0 * p["attitude.block_steps"])
    scale, speed = p["attitude.start_scale"], p["attitude.start_speed"]
    for i, variance in enumerate([bias] * 3 + [scale] * 3 + [tilt] * 2 + [speed] * 2):
        c.covariance[CELL[i][i]] = variance
    c.tilt_variance = 2 * p["attitude.start_tilt"]
    c.block_flags = c.block_flags | UNSURE

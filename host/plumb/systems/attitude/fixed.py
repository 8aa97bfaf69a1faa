"""`attitude` in integers: counts of six channels to a quaternion (docs/reference/arithmetic/attitude.md).

The functions have the names of that page. A branch that few steps take is a function of the state alone: with arrays,
`in_runs` does it for the runs that take it.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed import mounting, validity
from plumb.kernels.fixed.kernels import Params, calibrate
from plumb.kernels.fixed.mounting import mount
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32
from plumb.systems.attitude.fixed_covariance import (
    AXES,
    HORIZONTAL,
    VARIANCE_MAX_Q32,
    VELOCITY_Q28,
    sat32,
)
from plumb.systems.attitude.fixed_flight import MAYBE_LANDED_BLOCKS, follow_flight
from plumb.systems.attitude.fixed_gaps import (
    BRIDGED_MAX_Q18,
    LONGEST_RUN,
    VELOCITY_ADDED_MAX_Q26,
    bridge,
    count_clipped,
)
from plumb.systems.attitude.fixed_shock import RESTED, note_turn, travels
from plumb.systems.attitude.fixed_slices import LONG_RESTS, compute_slice, travel_square
from plumb.systems.attitude.fixed_state import (
    ACCEL_CLIPPED,
    AIRBORNE,
    ALIGNING,
    FALLING,
    GYRO_CLIPPED,
    JUDGED,
    MISSING,
    REST,
    SUMS,
    UNSURE,
    ControlState,
    clear,
    control_init,
    in_runs,
)
from plumb.systems.attitude.fixed_turns import align, matrix, turn_body

__all__ = ["control_init", "control_step"]

NO_SAMPLE = -32768
I32 = (1 << 31) - 1
HALF_ANGLE_MAX_Q30 = 461708984
SIXTH_Q32 = 715827883
ALIGN_LEAST_G_Q24, ALIGN_LEAST_GS_Q26, ALIGN_BLOCKS = 1258291, 1 << 20, 4
CLIPPED = GYRO_CLIPPED | ACCEL_CLIPPED
BY_TURN_MAX_Q32 = 1 << 30
TRAVEL_SQUARE_MAX_Q24 = 1 << 29
"""Of a velocity of +-4 g s in both axes."""


def coned(c: ControlState) -> list[Integer]:
    """The half angles of the step, with coning: plus a sixth of those of the step before, times (cross) these."""
    h, s = c.half, c.half_sixth
    return [h[i] + mul(s[i - 2], h[i - 1]) - mul(s[i - 1], h[i - 2]) for i in AXES]


def first_sample(c: ControlState, p: Params) -> None:
    x, y, z = (value >> 1 for value in c.accel)
    half = align(c, x, y, z, ALIGN_LEAST_G_Q24)
    c.started = select(half >= ALIGN_LEAST_G_Q24, 1, 0)
    remember(c)
    c.half_mean = list(c.half)


def remember(c: ControlState) -> None:
    """What the next step needs of this one."""
    c.half_sixth = [mul(angle, SIXTH_Q32) for angle in c.half]
    c.accel_sixth = [mul(value, SIXTH_Q32) for value in c.accel]


def sense(p: Params, raw: Sequence[Integer], group: str) -> tuple[list[Integer], Integer]:
    """Calibrated values of one sensor in the body's axes, and 1 where one of them was at its limit, else 0."""
    (x, at_x), (y, at_y), (z, at_z) = (calibrate(count, p, group) for count in raw)
    turned, over = mount(p, f"{group}_mounting", (x, y, z))
    mounted = p["attitude.mounted"] == 1
    values = [select(mounted, new, old) for new, old in zip(turned, (x, y, z), strict=True)]
    return values, at_x | at_y | at_z | select(mounted, int(over), 0)


def sample(c: ControlState, p: Params, raw: Sequence[Integer]) -> Integer:
    """Rates, accelerations and half angles of the counts; returns the flags of the step."""
    last = c.block_step + 1 == p["attitude.block_steps"]
    missing = (raw[0] == NO_SAMPLE) | (last & (c.gap != 0))
    rates, gyro_clipped = sense(p, raw[:3], "gyro")
    forces, accel_clipped = sense(p, raw[3:], "accel")
    marked = (raw[3] == NO_SAMPLE) & (raw[4] == NO_SAMPLE) & (raw[5] == NO_SAMPLE)
    rates_alone = (marked | (c.accel_run >= 2 * p["attitude.block_steps"])) & (accel_clipped != 0)
    unknown = select(missing, c.velocity_added, VELOCITY_ADDED_MAX_Q26)
    c.velocity_added = select(rates_alone, unknown, c.velocity_added)
    for i in AXES:
        upwards = select(c.started != 0, c.up[i] >> 5, 0)
        c.accel[i] = select(missing, c.accel[i], select(rates_alone, upwards, forces[i] >> 1))
        corrected = rates[i] - (c.bias[i] >> 4) - mul(c.scale[i], rates[i])
        c.rate[i] = select(missing, c.rate[i], corrected)
        half = mul(c.rate[i], p["attitude.half_angle"])
        c.half[i] = 4 * clamp(half, -HALF_ANGLE_MAX_Q30, HALF_ANGLE_MAX_Q30)
    c.missing_steps = c.missing_steps + select(missing, 1, 0)
    c.gap = select(missing, clamp(c.gap + 1, 0, LONGEST_RUN), c.gap)
    return select(missing, MISSING, gyro_clipped * GYRO_CLIPPED | accel_clipped * ACCEL_CLIPPED)


def force_of(c: ControlState) -> list[Integer]:
    """Mean acceleration of the step in the body axes of its end, with sculling, g Q25."""
    h, a, b = c.half, c.accel, c.accel_sixth
    e = [wrap_i32(c.half_sixth[i] - h[i]) for i in AXES]
    force = []
    for i in AXES:
        j, k = (i + 1) % 3, (i + 2) % 3
        force.append(a[i] + mul(e[j], a[k]) - mul(e[k], a[j]) + mul(b[j], h[k]) - mul(b[k], h[j]))
    return force


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step, c.thrust = c.step + 1, setpoint
    c.flags = flags = sample(c, p, raw)
    sampled = flags != MISSING
    bridged = sampled & (c.gap != 0)
    c.bridged_force = [0 * c.gap for _ in AXES]
    in_runs(c, p, bridged, bridge)
    in_runs(c, p, sampled & (((flags & CLIPPED) != 0) | (c.gyro_run != 0) | (c.accel_run != 0)), count_clipped)
    in_runs(c, p, c.started == 0, first_sample)

    force, turn = force_of(c), coned(c)
    remember(c)
    c.energy = c.energy + (turn_body(c, turn) >> 6)
    m, h = matrix(c.attitude), c.half
    for i in AXES:
        added = clamp(sat32(c.force_sum[i] + along(m[i], c.bridged_force)), -BRIDGED_MAX_Q18, BRIDGED_MAX_Q18)
        c.force_sum[i] = select(bridged, added, c.force_sum[i]) + (along(m[i], force) >> 5)
        c.half_sum[i] = wrap_i32(c.half_sum[i] + h[i])
        c.moved = c.moved | (abs(wrap_i32(h[i] - c.half_mean[i])) > p["attitude.rest_gyro"])
    aided = p["attitude.aid_s_q24"] != 0
    for i in HORIZONTAL:
        c.thrust_sum[i] = c.thrust_sum[i] + select(aided, mul(m[i][2], force[2]) >> 5, 0)
        for j in AXES:
            c.rows_sum[3 * i + j] = c.rows_sum[3 * i + j] + (m[i][j] >> 8)
            c.turned_sum[3 * i + j] = c.turned_sum[3 * i + j] + (mul(m[i][j], h[j]) >> 2)

    in_runs(c, p, bridged == 0, compute_slice)
    c.block_step = c.block_step + 1
    in_runs(c, p, c.block_step == p["attitude.block_steps"], close_block)
    c.up = matrix(c.attitude)[2]
    return (
        *raw, setpoint, *c.rate, *c.accel, *c.attitude, *c.up, *c.bias, *c.scale, *c.velocity,
        c.velocity_square, c.velocity_variance, c.tilt_variance, c.block_step, c.missing_steps,
        flags | c.block_flags, c.step,
    )  # fmt: skip


def along(row: Sequence[Integer], force: Sequence[Integer]) -> Integer:
    return mul(row[0], force[0]) + mul(row[1], force[1]) + mul(row[2], force[2])


def gained(c: ControlState, p: Params, i: int) -> Integer:
    """Velocity that the block has gained, g s Q28."""
    return sat32((c.force_sum[i] * p["attitude.dt_s_q33"]) >> 23)


def close_block(c: ControlState, p: Params) -> None:
    aligning = c.aligned_blocks < ALIGN_BLOCKS
    in_runs(c, p, aligning == 0, note_turn)
    for i in AXES:
        further = abs(wrap_i32(c.force_sum[i] - c.force_before[i])) > p["attitude.rest_accel"]
        c.moved = c.moved | further | (abs(c.half_sum[i]) > p["attitude.rest_turn"])
        c.half_mean[i] = mul(c.half_sum[i], p["attitude.inverse_block_q32"])
    c.force_before = list(c.force_sum)
    blocks = p["attitude.rest_blocks"]
    c.still_blocks = select((c.moved | c.airborne) != 0, 0, clamp(c.still_blocks + 1, 0, LONG_RESTS * blocks))
    before, c.block_flags = c.block_flags, select(c.still_blocks >= blocks, REST, 0)
    in_runs(c, p, aligning, align_block)
    in_runs(c, p, aligning == 0, measure_block)
    c.block_flags = c.block_flags | select(aligning, 0, before & JUDGED)
    clear(c, SUMS, 0 * c.block_step)


def align_block(c: ControlState, p: Params) -> None:
    up = c.correction[0]
    x, y = (sat32(c.velocity[i] + gained(c, p, i)) for i in HORIZONTAL)
    z = sat32(up + gained(c, p, 2))
    half = align(c, x >> 2, y >> 2, z >> 2, ALIGN_LEAST_GS_Q26)
    c.velocity = [0 * x, 0 * y]
    c.aligned_blocks = c.aligned_blocks + 1
    done = c.aligned_blocks == ALIGN_BLOCKS
    c.correction[0] = select(done, 0, clamp(8 * half, 0, I32))
    c.block_flags = c.block_flags | UNSURE | select(done, 0, ALIGNING)


def measure_block(c: ControlState, p: Params) -> None:
    dt = p["attitude.dt_s_q33"]
    time = (p["attitude.block_steps"] * dt) >> 1
    lever = sat32((c.force_sum[2] * dt) >> 20)
    c.half_lever = clamp(lever, time >> 2, time) >> 1
    for i in HORIZONTAL:
        for j in AXES:
            c.coupling[6 * i + j] = -((c.rows_sum[3 * i + j] * dt) >> 25)
            c.coupling[6 * i + 3 + j] = -(c.turned_sum[3 * i + j] >> 1)
    for i in HORIZONTAL:
        c.velocity[i] = sat32(c.velocity[i] + gained(c, p, i))
    in_runs(c, p, (p["attitude.aid_s_q24"] != 0) | (c.vehicle != 0), measure_velocity)
    lasting = clamp(travel_square(c) - (p["attitude.speed_min"] >> 2), 0, TRAVEL_SQUARE_MAX_Q24)
    doubt = select(travels(c) | (c.airborne == 1), 0, (lasting * p["attitude.doubt_q24"]) >> 16)
    by_turn = clamp(p["attitude.q_turn_q24"] + doubt, 0, BY_TURN_MAX_Q32)
    steps = p["attitude.block_steps"]
    blind = (c.gap >= steps) | (c.gyro_run >= steps)
    growth = p["attitude.q_tilt"] + ((c.energy * by_turn) >> 24) + c.tilt_added
    growth = growth + select(blind, p["attitude.q_clipped"], 0)
    c.tilt_growth = clamp(growth, 0, VARIANCE_MAX_Q32)
    c.velocity_growth = 16 * c.velocity_added
    c.block_flags = c.block_flags | select(lever < time >> 2, FALLING, 0) | c.airborne * AIRBORNE
    c.slice = 0 * time + 1
    c.aligned_blocks = select(c.still_blocks >= p["attitude.rest_blocks"], RESTED, c.aligned_blocks)


def measure_velocity(c: ControlState, p: Params) -> None:
    """The velocity that the block is measured to end with: zero, or in flight that of the drag."""
    inverse, before = p["attitude.inverse_block_q32"], c.airborne == 1
    follow_flight(c, p)
    airborne = (p["attitude.aid_s_q24"] != 0) & (c.carried_blocks < MAYBE_LANDED_BLOCKS)
    jumps, doubtful = airborne != before, airborne & (c.carried_blocks != 0)
    c.velocity_added = select(jumps | doubtful, VELOCITY_ADDED_MAX_Q26, c.velocity_added)
    c.airborne = select(airborne, 1, 0 * c.gap)
    for i in HORIZONTAL:
        across = mul(wrap_i32(c.force_sum[i] - c.thrust_sum[i]), inverse)
        drag = sat32((-across * p["attitude.aid_s_q24"]) >> 14)
        measured = clamp(sat32(drag + (gained(c, p, i) >> 1)), -VELOCITY_Q28, VELOCITY_Q28 - 1)
        c.measured[i] = select(airborne, measured, 0 * measured)
        c.travel[i] = select(jumps, 0 * measured, c.travel[i])


def control_valid(p: Params) -> bool:
    dt, steps, mounted = (int(p[f"attitude.{name}"]) for name in ("dt_s_q33", "block_steps", "mounted"))
    half_angle = int(p["attitude.half_angle"]) & 0xFFFFFFFF
    sensors = ("gyro", "accel")
    return (
        all(validity.calibration(p, name) and mounting.valid(p, f"{name}_mounting") for name in sensors)
        and 0 <= dt <= 188978561
        and 15 <= steps <= 125
        and mounted <= 1
        and steps * dt <= 2731598643
        and steps * half_angle <= 1 << 34
    )

"""`attitude` in integers: counts of six channels to a quaternion (docs/reference/arithmetic/attitude.md).

The functions have the names of that page. A branch that few steps take is a function of the state alone: with arrays,
`in_runs` does it for the runs that take it.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed import mounting, validity
from plumb.kernels.fixed.kernels import Params, calibrate
from plumb.kernels.fixed.mounting import mount
from plumb.kernels.fixed.quaternion import ONE_Q30
from plumb.kernels.fixed.trig import length, reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, select, wrap_i32, wrap_u32
from plumb.systems.attitude.fixed_covariance import (
    AXES,
    HORIZONTAL,
    VARIANCE_MAX_Q32,
    VELOCITY_MAX_Q28,
    compute_slice,
    mul,
    near,
    travel_square,
    travels,
    weighted,
)
from plumb.systems.attitude.fixed_gaps import (
    BRIDGED_MAX_Q18,
    LONGEST_RUN,
    VELOCITY_ADDED_MAX_Q26,
    bridged,
    count_clipped,
)
from plumb.systems.attitude.fixed_state import (
    ACCEL_CLIPPED,
    AIRBORNE,
    ALIGNING,
    BIAS,
    FALLING,
    GYRO_CLIPPED,
    JUDGED,
    MISSING,
    REST,
    SCALE,
    SUMS,
    TILT,
    UNSURE,
    VELOCITY,
    ControlState,
    clear,
    control_init,
    in_runs,
)

__all__ = ["control_init", "control_step"]

NO_SAMPLE = -32768
I32 = (1 << 31) - 1
HALF_ANGLE_MAX_Q30 = 461708984
SIXTH_Q32 = 715827883
ALIGN_LEAST_G_Q24, ALIGN_LEAST_GS_Q26, ALIGN_BLOCKS = 1258291, 1 << 20, 4
BIAS_MAX_Q32, SCALE_MAX_Q32, TURN_MAX_Q28 = 1 << 30, 1 << 28, 1 << 26
BIAS_UNIT_Q31 = 1367130551
CLIPPED = GYRO_CLIPPED | ACCEL_CLIPPED
RISE_MAX_Q18, BY_TURN_MAX_Q32 = 157286, 1 << 30
CARRIED_Q18, TAKE_OFF_BLOCKS = 209715, 4


def sat32(x: Integer) -> Integer:
    return clamp(x, -I32 - 1, I32)


def coned(c: ControlState) -> list[Integer]:
    """The half angles of the step, with coning: plus a sixth of those of the step before, times (cross) these."""
    h, s = c.half, c.half_sixth
    return [h[i] + mul(s[i - 2], h[i - 1]) - mul(s[i - 1], h[i - 2]) for i in AXES]


def turn_body(c: ControlState, h: Sequence[Integer]) -> Integer:
    """Turn the attitude by these half angles; returns the sum of their squares."""
    s = (mul(h[0], h[0]) + mul(h[1], h[1]) + mul(h[2], h[2])) >> 2
    inner = 4 * mul(s, ONE_Q30 - mul(s, 102261126))
    missing = 4 * mul(4 * mul(s, ONE_Q30 - mul(inner, 214748365)), SIXTH_Q32)
    inner = 4 * mul(s, ONE_Q30 - mul(s, 143165577))
    cosine = -8 * mul(s, ONE_Q30 - mul(inner, 357913941))
    x, y, z = (angle - mul(angle, missing) for angle in h)
    w, qx, qy, qz = c.attitude
    c.attitude = [
        w + mul(w, cosine) - mul(qx, x) - mul(qy, y) - mul(qz, z),
        qx + mul(qx, cosine) + mul(w, x) + mul(qy, z) - mul(qz, y),
        qy + mul(qy, cosine) + mul(w, y) + mul(qz, x) - mul(qx, z),
        qz + mul(qz, cosine) + mul(w, z) + mul(qx, y) - mul(qy, x),
    ]
    return s


def matrix(q: Sequence[Integer]) -> list[list[Integer]]:
    w, x, y, z = q
    xx, yy, zz = mul(x, x), mul(y, y), mul(z, z)
    xy, xz, yz = mul(x, y), mul(x, z), mul(y, z)
    wx, wy, wz = mul(w, x), mul(w, y), mul(w, z)
    rows = [
        [ONE_Q30 - 8 * (yy + zz), 8 * (xy - wz), 8 * (xz + wy)],
        [8 * (xy + wz), ONE_Q30 - 8 * (xx + zz), 8 * (yz - wx)],
        [8 * (xz - wy), 8 * (yz + wx), ONE_Q30 - 8 * (xx + yy)],
    ]
    return [[wrap_i32(entry) for entry in row] for row in rows]


def turn_earth(q: Sequence[Integer], w: Integer, x: Integer, y: Integer) -> list[Integer]:
    qw, qx, qy, qz = q
    turned = [
        4 * (mul(w, qw) - mul(x, qx) - mul(y, qy)),
        4 * (mul(w, qx) + mul(x, qw) + mul(y, qz)),
        4 * (mul(w, qy) + mul(y, qw) - mul(x, qz)),
        4 * (mul(w, qz) + mul(x, qy) - mul(y, qx)),
    ]
    squares = [mul(one, one) for one in turned]
    longer = 8 * ((1 << 28) - squares[0] - squares[1] - squares[2] - squares[3])
    return [one + mul(one, longer) for one in turned]


def align(c: ControlState, x: Integer, y: Integer, z: Integer, least: int) -> Integer:
    """Turn the earth so that the vector points up; returns half its length, below `least` nothing is turned."""
    half = 2 * length(length(y, x), z >> 1)
    w, qx, qy = half + (z >> 1), y >> 1, -(x >> 1)
    long = 4 * length(length(qy, qx), w >> 1)
    over = long < half >> 8
    divisor = clamp(long, 1, I32)
    n = clz32(divisor)
    v = reciprocal((divisor << n) >> 1)
    w, qx, qy = ((one * v) >> (32 - n) for one in (w, qx, qy))
    turned = turn_earth(c.attitude, select(over, 0, w), select(over, ONE_Q30, qx), select(over, 0, qy))
    c.attitude = [select(half >= least, new, old) for new, old in zip(turned, c.attitude, strict=True)]
    return half


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
    turned, limited = mount(p, f"{group}_mounting", (x, y, z))
    mounted = p["attitude.mounted"] == 1
    values = [select(mounted, new, old) for new, old in zip(turned, (x, y, z), strict=True)]
    return values, at_x | at_y | at_z | select(mounted, limited, 0)


def sample(c: ControlState, p: Params, raw: Sequence[Integer]) -> Integer:
    """Rates, accelerations and half angles of the counts; returns the flags of the step."""
    missing = raw[0] == NO_SAMPLE
    rates, gyro_clipped = sense(p, raw[:3], "gyro")
    forces, accel_clipped = sense(p, raw[3:], "accel")
    for i in AXES:
        c.accel[i] = select(missing, c.accel[i], forces[i] >> 1)
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
    in_runs(c, p, sampled & (c.gap != 0), bridge)
    in_runs(c, p, sampled & (((flags & CLIPPED) != 0) | (c.gyro_run != 0) | (c.accel_run != 0)), count_clipped)
    in_runs(c, p, c.started == 0, first_sample)

    force, turn = force_of(c), coned(c)
    remember(c)
    c.energy = c.energy + (turn_body(c, turn) >> 6)
    m, h = matrix(c.attitude), c.half
    for i in AXES:
        share = mul(m[i][0], force[0]) + mul(m[i][1], force[1]) + mul(m[i][2], force[2])
        c.force_sum[i] = c.force_sum[i] + (share >> 5)
        c.half_sum[i] = wrap_i32(c.half_sum[i] + h[i])
        c.moved = c.moved | (abs(wrap_i32(h[i] - c.half_mean[i])) > p["attitude.rest_gyro"])
    aided = p["attitude.aid_s_q24"] != 0
    for i in HORIZONTAL:
        c.thrust_sum[i] = c.thrust_sum[i] + select(aided, mul(m[i][2], force[2]) >> 5, 0)
        for j in AXES:
            c.rows_sum[3 * i + j] = c.rows_sum[3 * i + j] + (m[i][j] >> 8)
            c.turned_sum[3 * i + j] = c.turned_sum[3 * i + j] + (mul(m[i][j], h[j]) >> 2)

    compute_slice(c, p)
    c.block_step = c.block_step + 1
    in_runs(c, p, c.block_step == p["attitude.block_steps"], close_block)
    c.up = matrix(c.attitude)[2]
    return (
        *raw, setpoint, *c.rate, *c.accel, *c.attitude, *c.up, *c.bias, *c.scale, *c.velocity,
        c.velocity_square, c.velocity_variance, c.tilt_variance, c.block_step, c.missing_steps,
        flags | c.block_flags, c.step,
    )  # fmt: skip


def bridge(c: ControlState, p: Params) -> None:
    """A sample after a gap."""
    in_runs(c, p, c.started != 0, bridge_started)
    c.gap = 0 * c.gap


def bridge_started(c: ControlState, p: Params) -> None:
    turn, force = bridged(c, p)
    for _ in range(2):
        turn_body(c, turn)
    m = matrix(c.attitude)
    for i in AXES:
        share = mul(m[i][0], force[0]) + mul(m[i][1], force[1]) + mul(m[i][2], force[2])
        c.force_sum[i] = clamp(sat32(c.force_sum[i] + share), -BRIDGED_MAX_Q18, BRIDGED_MAX_Q18)


def tilted_at_rest(c: ControlState, p: Params) -> Integer:
    """Whether an acceleration of 1 g lies well off the vertical."""
    means = [mul(force, p["attitude.inverse_block_q32"]) for force in c.force_sum]
    squares = [mul(mean, mean) for mean in (wrap_i32(mean << 6) for mean in means)]
    total, up = wrap_u32(sum(squares)), squares[2]
    return (total > 59146) & (total < 72253) & ((means[2] < 0) | (100 * up < 81 * total))


def gained(c: ControlState, p: Params, i: int) -> Integer:
    """Velocity that the block has gained, g s Q28."""
    return sat32((c.force_sum[i] * p["attitude.dt_s_q33"]) >> 23)


def close_block(c: ControlState, p: Params) -> None:
    for i in AXES:
        further = abs(wrap_i32(c.force_sum[i] - c.force_before[i])) > p["attitude.rest_accel"]
        c.moved = c.moved | further | (abs(c.half_sum[i]) > p["attitude.rest_turn"])
        c.half_mean[i] = mul(c.half_sum[i], p["attitude.inverse_block_q32"])
    c.force_before = list(c.force_sum)
    blocks = p["attitude.rest_blocks"]
    c.still_blocks = select(c.moved != 0, 0, clamp(c.still_blocks + 1, 0, blocks))
    rise = (1 << 18) - mul(c.force_sum[2], p["attitude.inverse_block_q32"])
    c.rise = c.rise + near(rise - c.rise, p["attitude.travel_pass_q32"])
    at_rest = (c.still_blocks == blocks) & tilted_at_rest(c, p)
    c.lost = select((c.rise > RISE_MAX_Q18) | at_rest, 1, 0)
    before, c.block_flags = c.block_flags, select(c.still_blocks == blocks, REST, 0)
    aligning = c.aligned_blocks < ALIGN_BLOCKS
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
    correct(c, [gained(c, p, i) for i in HORIZONTAL])
    in_runs(c, p, p["attitude.aid_s_q24"] != 0, measure_velocity)
    doubt = select(travels(c), 0, (travel_square(c) * p["attitude.doubt_q24"]) >> 16)
    by_turn = clamp(p["attitude.q_turn_q24"] + doubt, 0, BY_TURN_MAX_Q32)
    steps = p["attitude.block_steps"]
    blind = (c.gap >= steps) | (c.gyro_run >= steps)
    growth = p["attitude.q_tilt"] + ((c.energy * by_turn) >> 24) + c.tilt_added
    growth = growth + select(blind, p["attitude.q_clipped"], 0)
    c.tilt_growth = clamp(growth, 0, VARIANCE_MAX_Q32)
    c.velocity_growth = 16 * c.velocity_added
    c.block_flags = c.block_flags | select(lever < time >> 2, FALLING, 0) | c.airborne * AIRBORNE
    c.slice = 0 * time + 1


def measure_velocity(c: ControlState, p: Params) -> None:
    """The velocity that the block is measured to end with: zero, or in flight that of the drag."""
    inverse = p["attitude.inverse_block_q32"]
    thrust = c.thrust >= p["attitude.aid_thrust_q15"]
    c.thrust_blocks = select(thrust, clamp(c.thrust_blocks + 1, 0, TAKE_OFF_BLOCKS), 0 * c.thrust_blocks)
    before = c.airborne == 1
    taken_off = thrust & (before | (c.thrust_blocks == TAKE_OFF_BLOCKS))
    airborne = taken_off | ((thrust == 0) & before & (mul(c.force_sum[2], inverse) < CARRIED_Q18))
    c.velocity_added = select(airborne != before, VELOCITY_ADDED_MAX_Q26, c.velocity_added)
    c.airborne = select(airborne, 1, 0 * c.gap)
    for i in HORIZONTAL:
        across = mul(wrap_i32(c.force_sum[i] - c.thrust_sum[i]), inverse)
        drag = sat32((-across * p["attitude.aid_s_q24"]) >> 14)
        measured = clamp(sat32(drag + (gained(c, p, i) >> 1)), -VELOCITY_MAX_Q28, VELOCITY_MAX_Q28)
        c.measured[i] = select(airborne, measured, 0 * measured)
        c.travel[i] = select(airborne, 0 * measured, c.travel[i])


def correct(c: ControlState, gains: Sequence[Integer]) -> None:
    """What the block has gained, and the corrections of the block before, propagated through this one."""
    d = c.correction

    def carry() -> None:
        d[8] = wrap_i32(d[8] + near(c.half_lever, d[7]))
        d[9] = wrap_i32(d[9] - near(c.half_lever, d[6]))

    carry()
    for i in HORIZONTAL:
        d[6 + i] = wrap_i32(d[6 + i] + weighted(c.coupling[6 * i : 6 * i + 6], d))
    carry()
    for i in AXES:
        change = clamp((d[BIAS + i] * BIAS_UNIT_Q31 + (1 << 30)) >> 31, -BIAS_MAX_Q32, BIAS_MAX_Q32)
        c.bias[i] = clamp(c.bias[i] + change, -BIAS_MAX_Q32, BIAS_MAX_Q32)
        c.scale[i] = clamp(c.scale[i] + (d[SCALE + i] >> 2), -SCALE_MAX_Q32, SCALE_MAX_Q32)
    x, y = (clamp(d[TILT + i], -TURN_MAX_Q28, TURN_MAX_Q28) for i in HORIZONTAL)
    c.attitude = turn_earth(c.attitude, ONE_Q30, 2 * x, 2 * y)
    f, g, u = c.force_before
    c.force_before = [
        wrap_i32(f + mul(16 * y, u)),
        wrap_i32(g - mul(16 * x, u)),
        wrap_i32(u + mul(16 * x, g) - mul(16 * y, f)),
    ]
    for i in HORIZONTAL:
        c.velocity[i] = sat32(c.velocity[i] + gains[i] + 2 * d[VELOCITY + i])


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

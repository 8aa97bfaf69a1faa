"""`turntable` in integers: two sensors of different rates to a quaternion (docs/reference/arithmetic/kernels.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed import validity
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.prefilter import FLAG_SAMPLE, Sensor
from plumb.kernels.fixed.quaternion import ONE_Q30, Quaternion, chosen, difference, rotate
from plumb.kernels.fixed.trig import reciprocal
from plumb.kernels.integers import Integer, clamp, clz32, select

RATE, GYRO_BIAS, ANGULAR_BIAS, DIFFERENCE, ANGLE = range(5)
DATA, ATTITUDE, PRINTED = range(3)
TOUCHED = (RATE, GYRO_BIAS, ANGULAR_BIAS, ANGLE)
AXES = range(3)

I32 = (1 << 31) - 1
RATE_MAX, INCREMENT_MAX, INNOVATION_MAX = 7 << 28, (1 << 30) - 1, 1 << 30
SHOCK_MAX, STILL_Q64 = 1 << 25, 1 << 32
SCALE_MAX = LAG_MAX = 1 << 28
BIAS_MAX = 0x7FFFFF00
CELL_MAX, ANGLE_MAX, GAIN_MAX = 1 << 58, 1 << 61, 1 << 30
SCALE_PROJECTED_MAX, LAG_PROJECTED_MAX = 1 << 29, 1 << 25
ANGULAR_STALE = 4

FLAG_SHOCK, FLAG_REST, FLAG_GYRO_LOST = 64, 128, 256


def sat_i32(x: Integer) -> Integer:
    """x, saturated to 32 bits."""
    return clamp(x, -I32 - 1, I32)


def mul_shift(a: Integer, b: Integer, n: int) -> Integer:
    """floor(a * b / 2^n) of a 64-bit a: exact in ints, by halves in arrays."""
    if isinstance(a, int) and isinstance(b, int):
        return (a * b) >> n
    return (((a >> 32) * b) << (32 - n)) + (((a & 0xFFFFFFFF) * b) >> n)


def add_scaled(x: Integer, a: Integer, b: Integer, n: int) -> Integer:
    """x + a * b / 2^n, rounded to nearest and saturated to 32 bits."""
    return sat_i32(x + ((a * b + (1 << (n - 1))) >> n))


@dataclass(slots=True)
class Parameter:
    """A constant that the second stage estimates (scale or lag), with the sensitivities of rate, gyro bias, angular
    bias and angle to it."""

    variance_q60: Integer
    sensitivity_q28: list[Integer] = field(default_factory=lambda: [0, 0, 0, 0])


@dataclass(slots=True)
class ControlState:
    gyro: Sensor
    angular: Sensor
    age_q24: Integer
    lag_q24: list[Integer]
    p: list[list[Integer]]
    scale: list[Parameter]
    lag: list[Parameter]
    attitude: Quaternion = (ONE_Q30, 0, 0, 0)
    attitude_angular: Quaternion = (ONE_Q30, 0, 0, 0)
    increment_q34: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    lagged_q34: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    innovation: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    rate: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    corrected: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    gyro_bias_q34: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    angular_bias_q42: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    scale_q30: list[Integer] = field(default_factory=lambda: [0, 0, 0])
    clamped_steps: Integer = 0
    step: int = 0


def control_init(p: Params) -> ControlState:
    cells = [[0] * 5 for _ in range(5)]
    cells[GYRO_BIAS][GYRO_BIAS] = p["fusion.p_gyro_bias_q40"] << 24
    cells[ANGULAR_BIAS][ANGULAR_BIAS] = p["fusion.p_angular_bias_q52"] << 12
    return ControlState(
        gyro=Sensor("gyro", p["fusion.gyro_period_step_q24"] >> 22),
        angular=Sensor("angular", ANGULAR_STALE),
        age_q24=p["fusion.gyro_age_step_q24"],
        lag_q24=[p["fusion.lag_step_q24"]] * 3,
        p=cells,
        scale=[Parameter(p["fusion.v_scale_q40"] << 20) for _ in AXES],
        lag=[Parameter(p["fusion.v_lag_q30"] << 30) for _ in AXES],
    )


def cell(p: list[list[Integer]], i: int, j: int) -> Integer:
    return p[max(i, j)][min(i, j)]


def put(p: list[list[Integer]], i: int, j: int, value: Integer) -> None:
    p[max(i, j)][min(i, j)] = value


def couple(p: list[list[Integer]], i: int, k: int, shift: int, where: Integer, sign: int) -> None:
    """Covariance update for error i += error k / 2^shift (sign -1: -=), in the runs `where`."""

    def part(j: int) -> Integer:
        return select(where, sign * (cell(p, k, j) >> shift), 0)

    put(p, i, i, cell(p, i, i) + part(i))
    for j in range(5):
        if j != i:
            put(p, i, j, cell(p, i, j) + part(j))
    put(p, i, i, cell(p, i, i) + part(i))


def predict(c: ControlState, p: Params, angular: Integer, two: Integer, dt: Integer) -> None:
    """Propagate the covariance by one step. two: runs with two separate attitudes."""
    m = c.p
    shares = [select(two, -mul_shift(cell(m, GYRO_BIAS, j), dt, 32), mul_shift(cell(m, RATE, j), dt, 32))
              for j in range(4)]  # fmt: skip
    for j, share in enumerate(shares):
        m[ANGLE][j] = m[ANGLE][j] + share
    couple(m, DIFFERENCE, RATE, 0, two, 1)
    couple(m, DIFFERENCE, GYRO_BIAS, 0, two, 1)
    couple(m, RATE, ANGULAR_BIAS, 2, angular, -1)
    m[RATE][RATE] = m[RATE][RATE] + select(
        angular, p["fusion.q_rate_q52"] << 12, p["fusion.q_rate_lost_q44"] << 20
    )  # fmt: skip
    m[GYRO_BIAS][GYRO_BIAS] = m[GYRO_BIAS][GYRO_BIAS] + (p["fusion.q_gyro_bias_q60"] << 4)
    m[ANGULAR_BIAS][ANGULAR_BIAS] = m[ANGULAR_BIAS][ANGULAR_BIAS] + p["fusion.q_angular_bias_q64"]
    bound(m)


def bound(m: list[list[Integer]]) -> None:
    """Clamp every element of the covariance to its limit."""
    for i in range(4):
        variance = m[i][i]
        outside = (variance > CELL_MAX) | (variance < 0)
        if outside is not False:
            for j in range(5):
                put(m, i, j, select(outside, clamp(variance, 0, CELL_MAX) if j == i else 0, cell(m, i, j)))
        for j in range(i + 1, 5):
            limit = ANGLE_MAX if j == ANGLE else CELL_MAX
            m[j][i] = select((m[j][i] > limit) | (m[j][i] < -limit), 0, m[j][i])


def reciprocal_of(s_q64: Integer) -> tuple[Integer, Integer]:
    """2^61 / the upper 31 bits of s, and the number of bits dropped."""
    n = clz32(s_q64 >> 32) - 1
    return reciprocal((s_q64 << n) >> 32), 32 - n


def ratio(u: Integer, y_q61: Integer, shift: Integer) -> Integer:
    return (sat_i32(u >> shift) * y_q61) >> 31


def measure(c: ControlState, u: list[Integer], s_q64: Integer, where: Integer) -> list[Integer]:
    """Gains of a measurement with u = P h; updates P in the runs `where`."""
    y, exponent = reciprocal_of(s_q64)
    gain = [clamp(ratio(row, y, exponent + 2), -GAIN_MAX, GAIN_MAX) for row in u]
    for i in range(5):
        for j in range(min(i, 3) + 1):
            c.p[i][j] = select(where, c.p[i][j] - mul_shift(u[j], gain[i], 28), c.p[i][j])
    bound(c.p)
    return gain


def correct(c: ControlState, i: int, gain: Sequence[Integer], innovation: Integer, where: Integer) -> None:
    """Correct rate and biases of one axis."""
    rate = clamp(add_scaled(c.rate[i], gain[RATE], innovation, 28), -RATE_MAX, RATE_MAX)
    gyro = clamp(add_scaled(c.gyro_bias_q34[i], gain[GYRO_BIAS], innovation, 22), -BIAS_MAX, BIAS_MAX)
    angular = clamp(add_scaled(c.angular_bias_q42[i], gain[ANGULAR_BIAS], innovation, 16), -BIAS_MAX, BIAS_MAX)
    c.rate[i] = select(where, rate, c.rate[i])
    c.gyro_bias_q34[i] = select(where, gyro, c.gyro_bias_q34[i])
    c.angular_bias_q42[i] = select(where, angular, c.angular_bias_q42[i])


def correction_q60(gain_q28: Integer, innovation: Integer) -> Integer:
    return 16 * clamp(gain_q28 * innovation, -(1 << 54), 1 << 54)


def update_zero_rate(c: ControlState, rest: Integer) -> None:
    """At rest: measurement update with rate 0."""
    u = [cell(c.p, i, RATE) for i in range(5)]
    gain = measure(c, u, u[RATE] + STILL_Q64, rest)
    for i in AXES:
        correct(c, i, gain, -c.rate[i], rest)
    merge_attitudes(c, rest)
    for j in range(4):
        c.p[ANGLE][j] = select(rest, 0, c.p[ANGLE][j])


def merge_attitudes(c: ControlState, where: Integer) -> None:
    """Merge the two attitudes into one."""
    c.attitude_angular = chosen(where, c.attitude, c.attitude_angular)
    for j in range(4):
        c.p[DIFFERENCE][j] = select(where, 0, c.p[DIFFERENCE][j])
    c.p[ANGLE][DIFFERENCE] = select(where, 0, c.p[ANGLE][DIFFERENCE])


@dataclass(slots=True)
class TurntableStep:
    """Intermediate values of one step."""

    gyro: Integer
    angular: Integer
    lost: Integer
    two_attitudes: Integer
    rest: Integer
    age_q24: Integer
    lagged_q34: list[Integer]
    expected: list[Integer]
    turn_q60: list[Integer]
    turn_angular_q60: list[Integer]
    shock: Integer = False


def propagate_rate(
    c: ControlState, p: Params, s: TurntableStep, before: Sequence[Integer], adjacent: Integer, dt: Integer
) -> None:  # fmt: skip
    """Propagate rate and lag of every axis by one step."""
    for i in AXES:
        twice = c.angular.value[i] + select(adjacent, before[i], c.angular.value[i])
        excess = add_scaled(0, ONE_Q30 - p["fusion.share_q30"], c.scale_q30[i], 30)
        driven = ((twice * dt + (1 << 26)) >> 27) - ((c.angular_bias_q42[i] + 128) >> 8)
        driven = driven + mul_shift(driven, excess, 30)
        rise = (c.gyro.last[i] - c.gyro.before[i]) * p["gyro.gain"]
        slope = select(s.lost, 0, (rise * p["fusion.gyro_samples_step_q30"]) >> 24)
        grown = clamp(select(s.angular, driven, slope), -INCREMENT_MAX, INCREMENT_MAX)
        follows = add_scaled(0, grown - c.lagged_q34[i], p["fusion.lag_alpha_q31"], 31)
        s.lagged_q34[i] = add_scaled(c.lagged_q34[i] + follows, -follows, s.age_q24, 24)
        s.turn_angular_q60[i] = s.turn_q60[i] = (c.rate[i] + ((grown + 64) >> 7)) * dt
        c.increment_q34[i] = grown
        c.lagged_q34[i] = c.lagged_q34[i] + follows
        c.rate[i] = clamp(c.rate[i] + ((grown + 32) >> 6), -RATE_MAX, RATE_MAX)
        at_sample = add_scaled(c.rate[i], -grown, s.age_q24, 30)
        s.expected[i] = add_scaled(at_sample, -s.lagged_q34[i], c.lag_q24[i], 30)


def predict_parameters(c: ControlState, p: Params, s: TurntableStep, where: Integer, dt: Integer) -> None:
    """Propagate the sensitivities by one step."""
    for i in AXES:
        drive = add_scaled(0, ONE_Q30 - p["fusion.share_q30"], c.increment_q34[i], 36)
        for parameter, driven in ((c.scale[i], select(s.angular, drive, 0)), (c.lag[i], 0)):
            v = parameter.sensitivity_q28
            angle = add_scaled(v[3], v[RATE], dt, 32)
            rate = sat_i32(v[RATE] + driven - select(s.angular, v[ANGULAR_BIAS] >> 2, 0))
            v[3], v[RATE] = select(where, angle, v[3]), select(where, rate, v[RATE])


def project(v: Sequence[Integer], age_q24: Integer, direct: Integer, limit: int) -> Integer:
    """Sensitivity of the innovation to the constant, clamped to +-limit."""
    through = sat_i32(v[RATE] + v[GYRO_BIAS] + direct)
    return clamp(add_scaled(through, v[ANGULAR_BIAS], age_q24, 26), -limit, limit)


def learn(
    c: ControlState, p: Params, s: TurntableStep, i: int, s_q64: Integer, gain: list[Integer], where: Integer
) -> list[Integer]:  # fmt: skip
    """Update scale and lag of one axis; returns the gains including their contribution."""
    direct = add_scaled(0, p["fusion.share_q30"], s.expected[i], 30)
    pairs = (
        (c.scale[i], project(c.scale[i].sensitivity_q28, s.age_q24, direct, SCALE_PROJECTED_MAX)),
        (c.lag[i], project(c.lag[i].sensitivity_q28, s.age_q24, -(s.lagged_q34[i] >> 6), LAG_PROJECTED_MAX)),
    )
    spread = s_q64
    for parameter, projected in pairs:
        v = parameter.sensitivity_q28
        for k, state in enumerate(TOUCHED):
            v[k] = select(where, add_scaled(v[k], gain[state], -projected, 28), v[k])
        spread = spread + 16 * mul_shift(mul_shift(parameter.variance_q60, projected, 28), projected, 28)
    learning = where & s.angular & (s.shock == 0)
    y, exponent = reciprocal_of(spread)
    learnt = []
    for parameter, projected in pairs:
        u = mul_shift(parameter.variance_q60, projected, 28)
        second = select(learning, ratio(u, y, exponent + 6), 0)
        left = parameter.variance_q60 - mul_shift(u, second, 20)
        parameter.variance_q60 = select(left < 0, 0, left)
        gain = list(gain)
        for k, state in enumerate(TOUCHED):
            gain[state] = add_scaled(gain[state], parameter.sensitivity_q28[k], second, 20)
        learnt.append(second)
    scale = clamp(add_scaled(c.scale_q30[i], learnt[0], c.innovation[i], 18), -SCALE_MAX, SCALE_MAX)
    lag = clamp(add_scaled(c.lag_q24[i], learnt[1], c.innovation[i], 24), 0, LAG_MAX)
    c.scale_q30[i] = select(learning, scale, c.scale_q30[i])
    c.lag_q24[i] = select(learning, lag, c.lag_q24[i])
    return gain


def compare_rates(c: ControlState, p: Params, s: TurntableStep, where: Integer) -> None:
    """Data layer: the difference of the rates is the innovation."""
    layer, share = p["fusion.layer"], p["fusion.share_q30"]
    largest: Integer = 0
    for i in AXES:
        scale = add_scaled(0, share, c.scale_q30[i], 30)
        bias = (c.gyro_bias_q34[i] + 32) >> 6
        seen = add_scaled(s.expected[i], s.expected[i], scale, 30) + bias
        spike = ((c.gyro.spikes >> i) & 1) != 0
        innovation = select(spike, 0, clamp(c.gyro.value[i] - seen, -INNOVATION_MAX, INNOVATION_MAX))
        c.innovation[i] = select(where, innovation, c.innovation[i])
        size = clamp(innovation, -SHOCK_MAX, SHOCK_MAX)
        square = 256 * size * size
        largest = select(square > largest, square, largest)

    def projected() -> tuple[list[Integer], Integer]:
        u = [
            cell(c.p, k, RATE) + cell(c.p, k, GYRO_BIAS) + mul_shift(cell(c.p, k, ANGULAR_BIAS), s.age_q24, 26)
            for k in range(5)
        ]
        sum_q64 = u[RATE] + u[GYRO_BIAS] + mul_shift(u[ANGULAR_BIAS], s.age_q24, 26)
        return u, select(sum_q64 < 0, 0, sum_q64) + (p["fusion.r_gyro_q44"] << 20)

    u, s_q64 = projected()
    s.shock = where & ((largest >> 5) > s_q64)
    c.p[RATE][RATE] = c.p[RATE][RATE] + select(s.shock, largest, 0)
    u, s_q64 = projected()
    first = measure(c, u, s_q64, where)
    for i in AXES:
        used = where & (((c.gyro.spikes >> i) & 1) == 0)
        learns = used & (s.rest == 0) & (layer != ATTITUDE)
        gain = learn(c, p, s, i, s_q64, first, learns) if learns is not False else first
        correct(c, i, gain, c.innovation[i], used)
        turned = used & (layer == DATA)
        s.turn_q60[i] = s.turn_q60[i] + select(turned, correction_q60(gain[ANGLE], c.innovation[i]), 0)


def align_gyro(c: ControlState, p: Params, s: TurntableStep, where: Integer, dt: Integer) -> None:
    """Attitude layer: propagate the gyro's own rate by one step; restart it where gyro samples have just returned."""
    period = add_scaled(0, dt, p["fusion.gyro_period_step_q24"], 24)
    for i in AXES:
        grown, rate = c.increment_q34[i], c.corrected[i]
        aligned = clamp(rate + ((grown + 32) >> 6), -RATE_MAX, RATE_MAX)
        turn = (rate + ((grown + 64) >> 7)) * dt
        sample = c.rate[i] - s.expected[i] + c.gyro.value[i] - ((c.gyro_bias_q34[i] + 32) >> 6)
        sample = clamp(sample, -RATE_MAX, RATE_MAX)
        used = s.gyro & (((c.gyro.spikes >> i) & 1) == 0)
        surprise = select(used, clamp(sample - aligned, -INNOVATION_MAX, INNOVATION_MAX), 0)
        turn = turn + ((surprise * period) >> 1)
        aligned = clamp(aligned + surprise, -RATE_MAX, RATE_MAX)
        anew = select(s.gyro, sample, c.rate[i])
        c.corrected[i] = select(where, select(s.two_attitudes, aligned, anew), c.corrected[i])
        s.turn_q60[i] = select(where & s.two_attitudes, turn, s.turn_q60[i])


def compare_attitudes(c: ControlState, p: Params, where: Integer, dt: Integer) -> None:
    """Attitude layer: the difference of the attitudes corrects both."""
    period = p["fusion.gyro_period_step_q24"]
    walk = mul_shift(mul_shift(p["fusion.r_gyro_q44"] << 20, period, 24), period, 24)
    c.p[DIFFERENCE][DIFFERENCE] = c.p[DIFFERENCE][DIFFERENCE] + select(where, walk, 0)
    c.p[ANGLE][DIFFERENCE] = c.p[ANGLE][DIFFERENCE] - select(where, mul_shift(walk, dt, 32), 0)
    u = [cell(c.p, k, DIFFERENCE) for k in range(5)]
    gain = measure(c, u, u[DIFFERENCE] + STILL_Q64, where)
    turns, turns_angular = [], []
    for i, apart in enumerate(difference(c.attitude_angular, c.attitude)):
        innovation = clamp(add_scaled(0, apart, p["fusion.step_hz_q16"], 20), -INNOVATION_MAX, INNOVATION_MAX)
        c.innovation[i] = select(where, innovation, c.innovation[i])
        correct(c, i, gain, innovation, where)
        corrected = clamp(add_scaled(c.corrected[i], gain[GYRO_BIAS], -innovation, 28), -RATE_MAX, RATE_MAX)
        c.corrected[i] = select(where, corrected, c.corrected[i])
        turns.append(correction_q60(gain[ANGLE], innovation))
        turns_angular.append(turns[-1] + add_scaled(0, gain[DIFFERENCE], innovation, 28) * dt)
    c.attitude = chosen(where, rotate(c.attitude, turns), c.attitude)
    c.attitude_angular = chosen(where, rotate(c.attitude_angular, turns_angular), c.attitude_angular)


def control_step(c: ControlState, p: Params, raw: Sequence[Integer], setpoint: Integer) -> tuple[Integer, ...]:
    """One step; returns the values of the record's words, in order."""
    c.step += 1
    dt, layer = p["fusion.dt_s_q32"], p["fusion.layer"]
    before, adjacent = list(c.angular.value), c.angular.gap == 0
    away = c.gyro.gap > c.gyro.stale
    gyro_flags, angular_flags = c.gyro.apply_sample(raw[:3], p), c.angular.apply_sample(raw[3:], p)
    age = c.age_q24 + (1 << 24)
    period = p["fusion.gyro_period_step_q24"]
    age = age - select(age >= period, period, 0)
    beside = ((gyro_flags & FLAG_SAMPLE) != 0) & (age >= 1 << 24)
    c.age_q24 = select(beside, select(age < period // 2, (1 << 24) - 1, 0), age)
    lost, rest = c.gyro.gap > c.gyro.stale, c.step <= p["fusion.rest_steps"]
    two = (layer == ATTITUDE) & (rest == 0)
    s = TurntableStep(
        gyro=(gyro_flags & FLAG_SAMPLE) != 0,
        angular=(angular_flags & FLAG_SAMPLE) != 0,
        lost=lost,
        two_attitudes=two & (lost == 0) & (away == 0),
        rest=rest,
        age_q24=select(c.age_q24 < 1 << 24, c.age_q24, 0),
        lagged_q34=[0, 0, 0],
        expected=[0, 0, 0],
        turn_q60=[0, 0, 0],
        turn_angular_q60=[0, 0, 0],
    )
    flags = gyro_flags | angular_flags << 1 | select(s.rest, FLAG_REST, 0) | select(s.lost, FLAG_GYRO_LOST, 0)
    c.clamped_steps = c.clamped_steps + select((flags & 3) != 0, 1, 0)

    propagate_rate(c, p, s, before, adjacent, dt)
    predict(c, p, s.angular, s.two_attitudes, dt)
    by_rates = (layer != ATTITUDE) & (s.rest == 0)
    if by_rates is not False:
        predict_parameters(c, p, s, by_rates, dt)
    if s.rest is not False:
        update_zero_rate(c, s.rest)
    comparing = s.gyro & (s.rest | (layer != ATTITUDE))
    if comparing is not False:
        compare_rates(c, p, s, comparing)
    flags = flags | select(s.shock, FLAG_SHOCK, 0)
    if two is not False:
        align_gyro(c, p, s, two, dt)
        c.attitude_angular = chosen(s.two_attitudes, rotate(c.attitude_angular, s.turn_angular_q60), c.attitude_angular)
    if s.rest is not True:
        c.attitude = chosen(s.rest == 0, rotate(c.attitude, s.turn_q60), c.attitude)
    alone = (layer == ATTITUDE) & (s.two_attitudes == 0)
    if alone is not False:
        merge_attitudes(c, alone)
    if (s.two_attitudes & s.gyro) is not False:
        compare_attitudes(c, p, s.two_attitudes & s.gyro, dt)
    c.corrected = [select(two, c.corrected[i], c.rate[i]) for i in AXES]
    return (
        *raw, setpoint,
        *c.gyro.last, *c.gyro.before, c.gyro.spikes, c.gyro.gap,
        *c.angular.last, *c.angular.before, c.angular.spikes, c.angular.gap,
        *c.gyro.value, *c.angular.value, c.age_q24,
        *c.increment_q34, *c.lagged_q34, *c.innovation,
        *c.attitude, *c.attitude_angular,
        *c.rate, *c.corrected, *c.gyro_bias_q34, *c.angular_bias_q42, *c.scale_q30, *c.lag_q24,
        c.clamped_steps,
        *(c.p[i][j] for i in range(5) for j in range(min(i, 3) + 1)),
        *(word for a in (*c.scale, *c.lag) for word in (a.variance_q60, *a.sensitivity_q28)),
        flags, c.step,
    )  # fmt: skip


FUSION_RANGES = {
    "layer": (DATA, PRINTED), "dt_s_q32": (1, 1 << 26), "step_hz_q16": (1, I32),
    "gyro_period_step_q24": (1 << 24, 1 << 28), "gyro_samples_step_q30": (1 << 26, 1 << 30),
    "lag_step_q24": (0, 1 << 28), "lag_alpha_q31": (0, I32), "share_q30": (0, 1 << 30),
    "r_gyro_q44": (1 << 12, (1 << 32) - 1), "v_lag_q30": (0, 1 << 30),
}  # fmt: skip


def control_valid(p: Params) -> bool:
    sensors = ("gyro", "angular")
    channels = all(validity.calibration(p, name) and validity.prefilter(p, f"{name}_filter") for name in sensors)
    ranges = all(low <= int(p[f"fusion.{name}"]) <= high for name, (low, high) in FUSION_RANGES.items())
    return channels and ranges and int(p["fusion.gyro_age_step_q24"]) < int(p["fusion.gyro_period_step_q24"])

"""`turntable` in integers: two sensors of different rates to a quaternion (docs/reference/arithmetic/turntable.md).

The functions have the names of firmware/systems/turntable*.c, without plumb_turntable_.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.kernels.fixed import fusion, validity
from plumb.kernels.fixed.fusion import ANGLE, ANGULAR_BIAS, DIFFERENCE, GYRO_BIAS, RATE, STATES
from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.prefilter import FLAG_SAMPLE, FLAG_SATURATED
from plumb.kernels.fixed.quaternion import ONE_Q30, difference, rotate
from plumb.kernels.integers import add_scaled, clamp, mul_shift, sat_i32
from plumb.systems.turntable.fixed_state import AXES, TurntableState, TurntableStep, control_init, is_spike

__all__ = ["control_init", "control_step", "control_valid"]

LAYER_DATA, LAYER_ATTITUDE = 0, 1
STEP_Q24 = 1 << 24
RATE_MAX, INCREMENT_MAX, INNOVATION_MAX = 7 << 28, (1 << 30) - 1, 1 << 30
SHOCK_MAX, STILL_Q64 = 1 << 25, 1 << 32
SCALE_MAX = LAG_MAX = 1 << 28
BIAS_MAX = 0x7FFFFF00
SCALE_PROJECTED_MAX, LAG_PROJECTED_MAX = 1 << 29, 1 << 25
FLAG_SHOCK, FLAG_REST, FLAG_GYRO_LOST = 64, 128, 256
FLAGS_SATURATED = FLAG_SATURATED | FLAG_SATURATED << 1


def prefilter_sensors(c: TurntableState, p: Params, s: TurntableStep, raw: Sequence[int]) -> None:
    """Convert counts to rate and angular acceleration, and determine when the gyro's sample was taken."""
    away = c.gyro.gap > c.gyro.stale
    gyro, angular = c.gyro.apply_sample(raw[:3], p), c.angular.apply_sample(raw[3:], p)
    s.gyro, s.angular = gyro & FLAG_SAMPLE != 0, angular & FLAG_SAMPLE != 0
    period = p["fusion.gyro_period_step_q24"]
    age = c.gyro_age_step_q24 + STEP_Q24
    if age >= period:
        age -= period
    if s.gyro and age >= STEP_Q24:
        age = STEP_Q24 - 1 if age < period // 2 else 0
    c.gyro_age_step_q24 = age
    s.gyro_lost = c.gyro.gap > c.gyro.stale
    s.two_attitudes = p["fusion.layer"] == LAYER_ATTITUDE and not s.rest and not s.gyro_lost and not away
    s.age_q24 = age if age < STEP_Q24 else 0
    c.flags = gyro | angular << 1 | (FLAG_REST if s.rest else 0) | (FLAG_GYRO_LOST if s.gyro_lost else 0)
    if c.flags & FLAGS_SATURATED:
        c.clamped_steps += 1


def increment(c: TurntableState, p: Params, s: TurntableStep, i: int, twice_q28: int) -> int:
    """Increment of the rate of one axis in this step, turn/s Q34. twice: sum of this sample and the previous one."""
    total = 0
    if s.angular:
        excess_q30 = add_scaled(0, ONE_Q30 - p["fusion.share_q30"], c.scale_q30[i], 30)
        total = (twice_q28 * p["fusion.dt_s_q32"] + (1 << 26)) >> 27
        total -= (c.bias_angular_turnps_q42[i] + 128) >> 8
        total += mul_shift(total, excess_q30, 30)
    elif not s.gyro_lost:
        rise_q28 = (c.gyro.last[i] - c.gyro.before[i]) * p["gyro.gain"]
        total = (rise_q28 * p["fusion.gyro_samples_step_q30"]) >> 24
    return clamp(total, -INCREMENT_MAX, INCREMENT_MAX)


def propagate_rate(c: TurntableState, p: Params, s: TurntableStep, before_q28: Sequence[int], adjacent: bool) -> None:
    """Propagate the rate of every axis by one step, and predict the gyro's reading at its sampling instant."""
    for i in AXES:
        now_q28 = c.angular.value[i]
        grown = increment(c, p, s, i, now_q28 + (before_q28[i] if adjacent else now_q28))
        lagged = c.increment_lagged_turnps_q34[i]
        follows = add_scaled(0, grown - lagged, p["fusion.lag_alpha_q31"], 31)
        s.lagged_q34[i] = add_scaled(lagged + follows, -follows, s.age_q24, 24)
        s.turn_angular_q60[i] = (c.rate_fused_turnps_q28[i] + ((grown + 64) >> 7)) * p["fusion.dt_s_q32"]
        c.increment_turnps_q34[i] = grown
        c.increment_lagged_turnps_q34[i] = lagged + follows
        rate = clamp(c.rate_fused_turnps_q28[i] + ((grown + 32) >> 6), -RATE_MAX, RATE_MAX)
        c.rate_fused_turnps_q28[i] = rate
        at_sample = add_scaled(rate, -grown, s.age_q24, 30)
        s.expected_q28[i] = add_scaled(at_sample, -s.lagged_q34[i], c.lag_step_q24[i], 30)
        s.turn_q60[i] = s.turn_angular_q60[i]


def predict(c: TurntableState, p: Params, s: TurntableStep) -> None:
    """Propagate the covariance, and the sensitivities of the second stage."""
    dt = p["fusion.dt_s_q32"]
    step = fusion.Predict(
        angular=s.angular,
        difference=s.two_attitudes,
        rate_q64=p["fusion.q_rate_q52"] << 12 if s.angular else p["fusion.q_rate_lost_q44"] << 20,
        gyro_bias_q64=p["fusion.q_gyro_bias_q60"] << 4,
        angular_bias_q64=p["fusion.q_angular_bias_q64"],
    )
    fusion.predict(c.covariance_q64, step, dt)
    if s.rest or p["fusion.layer"] == LAYER_ATTITUDE:
        return
    for i in AXES:
        drive = add_scaled(0, ONE_Q30 - p["fusion.share_q30"], c.increment_turnps_q34[i], 36)
        fusion.parameter_predict(c.scale[i], s.angular, drive if s.angular else 0, dt)
        fusion.parameter_predict(c.lag[i], s.angular, 0, dt)


def corrected(x: int, gain_q28: int, innovation_q28: int, shift: int, limit: int) -> int:
    """x + gain * innovation, clamped to +-limit."""
    return clamp(add_scaled(x, gain_q28, innovation_q28, shift), -limit, limit)


def correct(c: TurntableState, i: int, gain: Sequence[int], z: int) -> None:
    """Correct rate and biases of one axis by a measurement with the innovation z."""
    c.rate_fused_turnps_q28[i] = corrected(c.rate_fused_turnps_q28[i], gain[RATE], z, 28, RATE_MAX)
    c.bias_gyro_turnps_q34[i] = corrected(c.bias_gyro_turnps_q34[i], gain[GYRO_BIAS], z, 22, BIAS_MAX)
    c.bias_angular_turnps_q42[i] = corrected(c.bias_angular_turnps_q42[i], gain[ANGULAR_BIAS], z, 16, BIAS_MAX)


def correction_q60(gain_q28: int, innovation_q28: int) -> int:
    """A rotation of gain times innovation, turn Q60, within a quarter turn."""
    return 16 * clamp(gain_q28 * innovation_q28, -(1 << 54), 1 << 54)


def merge_attitudes(c: TurntableState) -> None:
    """Merge the two attitudes into one."""
    c.attitude_angular = c.attitude
    for j in STATES:
        c.covariance_q64[DIFFERENCE][j] = 0
    c.covariance_q64[ANGLE][DIFFERENCE] = 0


def update_zero_rate(c: TurntableState) -> None:
    """At rest: measurement update with rate 0."""
    u, variance = fusion.project_state(c.covariance_q64, RATE)
    gain = fusion.gains(u, variance + STILL_Q64)
    fusion.update(c.covariance_q64, gain, u)
    for i in AXES:
        correct(c, i, gain, -c.rate_fused_turnps_q28[i])
    merge_attitudes(c)
    c.covariance_q64[ANGLE] = [0, 0, 0, 0]


def learn(c: TurntableState, p: Params, s: TurntableStep, i: int, s_q64: int, gain: list[int]) -> None:
    """Second stage of one axis: estimate scale and lag from the innovation, and add their part to the gains."""
    direct = add_scaled(0, p["fusion.share_q30"], s.expected_q28[i], 30)
    scale = fusion.parameter_project(c.scale[i], s.age_q24, direct, SCALE_PROJECTED_MAX)
    lag = fusion.parameter_project(c.lag[i], s.age_q24, -(s.lagged_q34[i] >> 6), LAG_PROJECTED_MAX)
    fusion.parameter_update(c.scale[i], gain, scale)
    fusion.parameter_update(c.lag[i], gain, lag)
    if not s.angular or s.shock:
        return
    innovation = c.innovation_turnps_q28[i]
    scale_q60, lag_q60 = fusion.parameter_cross(c.scale[i], scale), fusion.parameter_cross(c.lag[i], lag)
    y = fusion.inverse(s_q64 + 16 * mul_shift(scale_q60, scale, 28) + 16 * mul_shift(lag_q60, lag, 28))
    scale_gain = fusion.parameter_learn(c.scale[i], scale_q60, y, gain)
    lag_gain = fusion.parameter_learn(c.lag[i], lag_q60, y, gain)
    c.scale_q30[i] = corrected(c.scale_q30[i], scale_gain, innovation, 18, SCALE_MAX)
    c.lag_step_q24[i] = max(corrected(c.lag_step_q24[i], lag_gain, innovation, 24, LAG_MAX), 0)


def compare_rates(c: TurntableState, p: Params, s: TurntableStep) -> None:
    """Data layer: compare the gyro's sample with the predicted rate."""
    largest_q64 = 0
    for i in AXES:
        rate = s.expected_q28[i]
        scale_q30 = add_scaled(0, p["fusion.share_q30"], c.scale_q30[i], 30)
        seen = add_scaled(rate, rate, scale_q30, 30) + ((c.bias_gyro_turnps_q34[i] + 32) >> 6)
        innovation = 0 if is_spike(c, i) else sat_i32(c.gyro.value[i] - seen)
        c.innovation_turnps_q28[i] = clamp(innovation, -INNOVATION_MAX, INNOVATION_MAX)
        size = clamp(innovation, -SHOCK_MAX, SHOCK_MAX)
        largest_q64 = max(largest_q64, 256 * size * size)
    r_q64 = p["fusion.r_gyro_q44"] << 20
    u, variance = fusion.project_rate(c.covariance_q64, s.age_q24)
    s.shock = largest_q64 >> 5 > variance + r_q64
    if s.shock:
        c.flags |= FLAG_SHOCK
        c.covariance_q64[RATE][RATE] += largest_q64
        u, variance = fusion.project_rate(c.covariance_q64, s.age_q24)
    s_q64 = variance + r_q64
    first = fusion.gains(u, s_q64)
    fusion.update(c.covariance_q64, first, u)
    for i in AXES:
        gain = list(first)
        if is_spike(c, i):
            continue
        if not s.rest and p["fusion.layer"] != LAYER_ATTITUDE:
            learn(c, p, s, i, s_q64, gain)
        correct(c, i, gain, c.innovation_turnps_q28[i])
        if p["fusion.layer"] == LAYER_DATA:
            s.turn_q60[i] += correction_q60(gain[ANGLE], c.innovation_turnps_q28[i])


def sampled(c: TurntableState, s: TurntableStep, i: int) -> int:
    """Rate of the step from the gyro's sample, which is slightly older than the step."""
    ahead_q28 = c.rate_fused_turnps_q28[i] - s.expected_q28[i]
    sample_q28 = ahead_q28 + c.gyro.value[i] - ((c.bias_gyro_turnps_q34[i] + 32) >> 6)
    return clamp(sample_q28, -RATE_MAX, RATE_MAX)


def align_gyro(c: TurntableState, p: Params, s: TurntableStep) -> None:
    """Attitude layer: the gyro's own rate, propagated to the steps by the angular acceleration."""
    period_s_q32 = add_scaled(0, p["fusion.dt_s_q32"], p["fusion.gyro_period_step_q24"], 24)
    for i in AXES:
        grown, rate = c.increment_turnps_q34[i], c.rate_corrected_turnps_q28[i]
        aligned = clamp(rate + ((grown + 32) >> 6), -RATE_MAX, RATE_MAX)
        s.turn_q60[i] = (rate + ((grown + 64) >> 7)) * p["fusion.dt_s_q32"]
        if s.gyro and not is_spike(c, i):
            surprise = clamp(sampled(c, s, i) - aligned, -INNOVATION_MAX, INNOVATION_MAX)
            s.turn_q60[i] += (surprise * period_s_q32) >> 1
            aligned = clamp(aligned + surprise, -RATE_MAX, RATE_MAX)
        c.rate_corrected_turnps_q28[i] = aligned


def compare_attitudes(c: TurntableState, p: Params) -> None:
    """Attitude layer: correct both attitudes by their difference."""
    period_q24, dt = p["fusion.gyro_period_step_q24"], p["fusion.dt_s_q32"]
    walk_q64 = mul_shift(mul_shift(p["fusion.r_gyro_q44"] << 20, period_q24, 24), period_q24, 24)
    c.covariance_q64[DIFFERENCE][DIFFERENCE] += walk_q64
    c.covariance_q64[ANGLE][DIFFERENCE] -= mul_shift(walk_q64, dt, 32)
    u, variance = fusion.project_state(c.covariance_q64, DIFFERENCE)
    gain = fusion.gains(u, variance + STILL_Q64)
    fusion.update(c.covariance_q64, gain, u)
    turn_q60, turn_angular_q60 = [], []
    for i, apart_turn_q32 in enumerate(difference(c.attitude_angular, c.attitude)):
        apart = add_scaled(0, apart_turn_q32, p["fusion.step_hz_q16"], 20)
        innovation = clamp(apart, -INNOVATION_MAX, INNOVATION_MAX)
        c.innovation_turnps_q28[i] = innovation
        correct(c, i, gain, innovation)
        rate = c.rate_corrected_turnps_q28[i]
        c.rate_corrected_turnps_q28[i] = corrected(rate, gain[GYRO_BIAS], -innovation, 28, RATE_MAX)
        turn_q60.append(correction_q60(gain[ANGLE], innovation))
        turn_angular_q60.append(turn_q60[i] + add_scaled(0, gain[DIFFERENCE], innovation, 28) * dt)
    c.attitude = rotate(c.attitude, turn_q60)
    c.attitude_angular = rotate(c.attitude_angular, turn_angular_q60)


def propagate_attitude(c: TurntableState, p: Params, s: TurntableStep) -> None:
    """Propagate both attitudes by one step. A gyro that has just returned starts anew, with its own sample and the
    attitude of the other sensor."""
    if s.two_attitudes:
        align_gyro(c, p, s)
        c.attitude_angular = rotate(c.attitude_angular, s.turn_angular_q60)
        c.attitude = rotate(c.attitude, s.turn_q60)
        if s.gyro:
            compare_attitudes(c, p)
        return
    back = p["fusion.layer"] == LAYER_ATTITUDE and not s.rest and s.gyro
    for i in AXES:
        c.rate_corrected_turnps_q28[i] = sampled(c, s, i) if back else c.rate_fused_turnps_q28[i]
    if not s.rest:
        c.attitude = rotate(c.attitude, s.turn_q60)
    if p["fusion.layer"] == LAYER_ATTITUDE:
        merge_attitudes(c)


def control_step(c: TurntableState, p: Params, raw: Sequence[int], setpoint: int) -> tuple[int, ...]:
    """One step; returns the values of the record's words, in order."""
    before_q28, adjacent = list(c.angular.value), c.angular.gap == 0
    c.step += 1
    s = TurntableStep(rest=c.step <= p["fusion.rest_steps"])
    prefilter_sensors(c, p, s, raw)
    propagate_rate(c, p, s, before_q28, adjacent)
    predict(c, p, s)
    if s.rest:
        update_zero_rate(c)
    if s.gyro and (s.rest or p["fusion.layer"] != LAYER_ATTITUDE):
        compare_rates(c, p, s)
    propagate_attitude(c, p, s)
    return (
        *raw, setpoint,
        *c.gyro.last, *c.gyro.before, c.gyro.spikes, c.gyro.gap,
        *c.angular.last, *c.angular.before, c.angular.spikes, c.angular.gap,
        *c.gyro.value, *c.angular.value, c.gyro_age_step_q24,
        *c.increment_turnps_q34, *c.increment_lagged_turnps_q34, *c.innovation_turnps_q28,
        *c.attitude, *c.attitude_angular,
        *c.rate_fused_turnps_q28, *c.rate_corrected_turnps_q28,
        *c.bias_gyro_turnps_q34, *c.bias_angular_turnps_q42, *c.scale_q30, *c.lag_step_q24,
        c.clamped_steps,
        *(entry for row in c.covariance_q64 for entry in row),
        *(word for a in (*c.scale, *c.lag) for word in (a.variance_q60, *a.sensitivity_q28)),
        c.flags, c.step,
    )  # fmt: skip


def control_valid(p: Params) -> bool:
    sensors = ("gyro", "angular")
    channels = all(validity.calibration(p, name) and validity.prefilter(p, f"{name}_filter") for name in sensors)
    return channels and fusion.valid(p)

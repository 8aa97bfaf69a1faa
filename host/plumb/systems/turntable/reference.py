"""`turntable` in float64: gyro and angular accelerometer to a quaternion, both layers.

The errors of rate, gyro bias, angular bias, difference of the attitudes and published angle are the state

    e = [rate, gyro bias, angular bias, difference, angle]      deg/s, deg/s, deg/s^2, deg, deg
    rate' = -angular bias + noise of the angular accelerometer;  difference' = rate + gyro bias;  angle' = rate
    (attitude layer: angle' = -gyro bias)

of an ordinary Kalman filter, P = F P F^T + Q, K = P h / (h P h + R), P = P - K (P h)^T. Difference in scale and lag are
constants that the filter does not know: their second stage is Friedland's (1969, "Treatment of bias in recursive
filtering"), with V the sensitivity of e to the constant, S that of the innovation:

    V = F V + B;  S = h V + D;  V = V - K S;  G = M S / (s + S M S);  M = M - G S M;  K = K + V G

Every quantity is an array with one row per run and one column per axis; P is shared by the axes of a run.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.tuning import Channel
from plumb.systems.turntable.settings import Prefilter
from plumb.systems.turntable.tuning import TurntableTuning

RATE, GYRO_BIAS, ANGULAR_BIAS, DIFFERENCE, ANGLE = range(5)
NO_SAMPLE = -32768
Rule = Literal["trapezium", "rectangle"]
"""How angular acceleration becomes rate: by the mean of two samples, as the integers have it, or by the last one alone,
omega(k) = omega(k-1) + alpha(k) dt, as the patent prints it; the latter runs half a step ahead."""
STILL_DPS2 = 360.0**2 / 2.0**32
"""Measurement variance of the zero-rate update at rest and, per step, of merging the two attitudes."""
SHOCK = 32.0
"""Squared innovation, in variances, above which the rate changed without the angular accelerometer measuring it."""
SHOCK_DPS, INCREMENT_DPS, CELL_DPS2 = 45.0, 22.5, 360.0**2 / 2.0**6


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Product of quaternions w, x, y, z along the last axis."""
    pw, px, py, pz = (p[..., i] for i in range(4))
    qw, qx, qy, qz = (q[..., i] for i in range(4))
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def turned(q: FloatArray, rotation_deg: FloatArray) -> FloatArray:
    """q after the body rotates by a rotation vector in deg."""
    half = np.radians(rotation_deg) / 2.0
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    result = multiply(q, np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1))
    return np.asarray(result / np.linalg.norm(result, axis=-1, keepdims=True), np.float64)


def rotation_deg(start: FloatArray, end: FloatArray) -> FloatArray:
    """Rotation vector in the body's axes, at most 180 deg long, from one attitude to the other, deg."""
    d = multiply(start * np.array([1.0, -1.0, -1.0, -1.0]), end)
    d = np.where(d[..., :1] < 0.0, -d, d)
    sine = np.linalg.norm(d[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, d[..., :1])
    return np.asarray(np.degrees(np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0) * d[..., 1:]), np.float64)


@dataclass
class Sensor:
    """State of a sensor's prefilter. last, before: counts of the last two samples; value: calibrated and smoothed."""

    channel: Channel
    settings: Prefilter
    stale_steps: int
    last: FloatArray
    before: FloatArray
    value: FloatArray
    spike: BoolArray
    gap_steps: npt.NDArray[np.int_]

    @classmethod
    def of(cls, channel: Channel, settings: Prefilter, stale_steps: int, runs: int) -> Sensor:
        zero = np.zeros((runs, 3))
        none = np.full((runs, 1), 65535)
        return cls(channel, settings, stale_steps, zero, zero, zero, np.zeros((runs, 3), np.bool_), none)

    def apply_sample(self, counts: FloatArray) -> BoolArray:
        """Process the counts of one step; returns True for the runs with a sample, (runs, 1)."""
        low, high = self.channel.min_counts, self.channel.max_counts
        inside = (counts != NO_SAMPLE) & (counts >= low) & (counts <= high)
        present: BoolArray = np.all(inside, axis=1, keepdims=True)
        fresh = self.gap_steps > self.stale_steps
        line = 2.0 * self.last - self.before
        off = np.abs(counts - line) > round(self.settings.spike / abs(self.channel.unit_per_count))
        spike = ~fresh & ~self.spike & off
        before = np.where(fresh | (self.spike & off), counts, self.last)
        last = np.where(spike, np.clip(line, low, high), counts)
        now = (last - self.channel.zero_counts) * self.channel.unit_per_count
        value = np.where(fresh, now, self.value + self.settings.smooth * (now - self.value))
        self.before, self.last = np.where(present, before, self.before), np.where(present, last, self.last)
        self.value, self.spike = np.where(present, value, self.value), np.where(present, spike, self.spike)
        self.gap_steps = np.where(present, 0, np.minimum(self.gap_steps + 1, 65535))
        return present


@dataclass
class State:
    """State of the filter; arrays are (runs, 3), except age_s: (runs, 1); p: (runs, 5, 5); v: (runs, 3, 5, 2) and
    m: (runs, 3, 2), whose last axis is scale, lag."""

    gyro: Sensor
    angular: Sensor
    age_s: FloatArray
    attitude: FloatArray
    attitude_angular: FloatArray
    rate: FloatArray
    gyro_rate: FloatArray
    gyro_bias: FloatArray
    angular_bias: FloatArray
    scale: FloatArray
    lag_s: FloatArray
    lagged: FloatArray
    p: FloatArray
    v: FloatArray
    m: FloatArray
    innovation: FloatArray
    step: int = 0
    rule: Rule = "trapezium"
    increment: FloatArray = field(default_factory=lambda: np.zeros((1, 3)))


def start(t: TurntableTuning, phase_s: FloatArray) -> State:
    """State before the first step. phase_s: a sampling instant of every run's gyro, (runs,)."""
    runs = len(phase_s)
    f, zero = t.fusion, np.zeros((runs, 3))
    one = np.tile([1.0, 0.0, 0.0, 0.0], (runs, 1))
    p, m = np.zeros((runs, 5, 5)), np.empty((runs, 3, 2))
    p[:, GYRO_BIAS, GYRO_BIAS], p[:, ANGULAR_BIAS, ANGULAR_BIAS] = f.start_gyro_dps**2, f.start_angular_dps2**2
    m[..., 0], m[..., 1] = f.gyro_scale**2 + f.angular_scale**2, f.start_lag_s**2
    stale = int(4.0 * f.gyro_period_s / t.period_s * (1 + 1e-12))
    gyro, angular = Sensor.of(t.gyro, t.gyro_filter, stale, runs), Sensor.of(t.angular, t.angular_filter, 4, runs)
    age_s = ((-t.period_s - phase_s) % f.gyro_period_s)[:, None]
    lag_s, v = np.full((runs, 3), f.lag_s), np.zeros((runs, 3, 5, 2))
    return State(
        gyro, angular, age_s, one, one, zero, zero, zero, zero, zero, lag_s, zero, p, v, m, zero
    )  # fmt: skip


def measure(x: State, h: FloatArray, r: float, where: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Update P by a measurement h (runs, 5) in the runs `where`; returns the gains (runs, 5) and the variance of the
    innovation."""
    u = np.einsum("rij,rj->ri", x.p, h)
    s = np.einsum("ri,ri->r", u, h)[:, None] + r
    gain = np.where(where, u / s, 0.0)
    x.p = x.p - gain[:, :, None] * u[:, None, :]
    return gain, s


def correct(x: State, gain: FloatArray, innovation: FloatArray) -> None:
    """Correct rate and biases. gain: (runs, 3, 5)."""
    x.rate = x.rate + gain[..., RATE] * innovation
    x.gyro_bias = x.gyro_bias + gain[..., GYRO_BIAS] * innovation
    x.angular_bias = x.angular_bias + gain[..., ANGULAR_BIAS] * innovation


def predict(x: State, t: TurntableTuning, angular: BoolArray, two: BoolArray) -> None:
    """Propagate P and V by one step. two: runs with two separate attitudes."""
    f, dt = t.fusion, t.period_s
    transition = np.tile(np.eye(5), (len(x.p), 1, 1))
    transition[:, RATE, ANGULAR_BIAS] = -dt * angular[:, 0]
    transition[:, DIFFERENCE, RATE] = transition[:, DIFFERENCE, GYRO_BIAS] = dt * two[:, 0]
    transition[:, ANGLE, RATE], transition[:, ANGLE, GYRO_BIAS] = dt * ~two[:, 0], -dt * two[:, 0]
    x.p = transition @ x.p @ np.swapaxes(transition, 1, 2)
    density = np.where(angular[:, 0], f.angular_dps2, f.lost_dps2)
    x.p[:, RATE, RATE] += density**2 * dt
    x.p[:, GYRO_BIAS, GYRO_BIAS] += f.gyro_walk_dps**2 * dt
    x.p[:, ANGULAR_BIAS, ANGULAR_BIAS] += f.angular_walk_dps2**2 * dt
    x.v = np.einsum("rij,rajk->raik", transition, x.v)
    share = gyro_share(t)
    x.v[..., RATE, 0] += np.where(angular, (1.0 - share) * x.increment, 0.0)


def gyro_share(t: TurntableTuning) -> float:
    """Share of a scale difference that is attributed to the gyro, from the variances of the two scales."""
    both = t.fusion.gyro_scale**2 + t.fusion.angular_scale**2
    return t.fusion.gyro_scale**2 / both if both else 0.5


def step(x: State, t: TurntableTuning, counts: FloatArray) -> None:
    """One step of all runs. counts: (runs, 6)."""
    f, dt = t.fusion, t.period_s
    x.step += 1
    rest = x.step <= round(f.rest_s / dt)
    before, adjacent = x.angular.value, x.angular.gap_steps == 0
    away = x.gyro.gap_steps > x.gyro.stale_steps
    gyro, angular = x.gyro.apply_sample(counts[:, :3]), x.angular.apply_sample(counts[:, 3:])
    lost = x.gyro.gap_steps > x.gyro.stale_steps
    age_s = (x.age_s + dt) % f.gyro_period_s
    age_s = np.where(f.gyro_period_s - age_s < 1e-9 * dt, 0.0, age_s)
    # a sample came in the first step after it: so clocks may drift, and begin anywhere
    first = np.where(age_s < f.gyro_period_s / 2.0, (1.0 - 2.0**-24) * dt, 0.0)
    x.age_s = np.where(gyro & (age_s >= dt), first, age_s)
    age_s = np.where(x.age_s < dt, x.age_s, 0.0)

    # the rate's increment: the mean of two samples of angular acceleration; without them the gyro's slope
    share = gyro_share(t)
    mean = (x.angular.value + np.where(adjacent & (x.rule == "trapezium"), before, x.angular.value)) / 2.0
    slope = (x.gyro.last - x.gyro.before) * t.gyro.unit_per_count / f.gyro_period_s
    driven = (mean - x.angular_bias) * (1.0 + (1.0 - share) * x.scale)
    increment = dt * np.where(angular, driven, np.where(lost, 0.0, slope))
    x.increment = np.clip(increment, -INCREMENT_DPS, INCREMENT_DPS)
    follows = (x.increment - x.lagged) * (-np.expm1(-dt / f.lag_s) if f.lag_s else 1.0)
    x.lagged = x.lagged + follows
    lagged_at_sample = (x.lagged - follows * age_s / dt) / dt
    turn_angular = (x.rate + x.increment / 2.0) * dt
    x.rate = x.rate + x.increment
    expected = x.rate - x.increment * age_s / dt - x.lag_s * lagged_at_sample

    attitude_layer = f.layer == "attitude"
    two = ~lost & ~away & (attitude_layer and not rest)
    predict(x, t, angular, two)
    if rest or attitude_layer:
        x.v[:] = 0.0
    everywhere = np.ones((len(x.p), 1), np.bool_)
    if rest:
        h = np.zeros((len(x.p), 5))
        h[:, RATE] = 1.0
        gain, _ = measure(x, h, STILL_DPS2, everywhere)
        correct(x, np.broadcast_to(gain[:, None], (len(gain), 3, 5)), -x.rate)
        x.p[:, DIFFERENCE:, :] = x.p[:, :, DIFFERENCE:] = 0.0
    turn = turn_angular
    if gyro.any() and (rest or not attitude_layer):
        turn = turn + compare_rates(x, t, expected, lagged_at_sample, age_s, gyro, angular, rest)
    if rest:
        x.gyro_rate = x.rate
        return
    if not attitude_layer:
        x.gyro_rate = x.rate
        x.attitude = turned(x.attitude, turn)
        return

    # attitude layer: the gyro's own rate, aligned to the steps; half of a sample's surprise is made up for; where the
    # gyro was away, it begins anew: its rate with the sample, its attitude as the other one's
    ahead = x.rate - expected
    aligned, turn = x.gyro_rate + x.increment, (x.gyro_rate + x.increment / 2.0) * dt
    sample = x.gyro.value - x.gyro_bias + ahead
    surprise = np.where(gyro & ~x.gyro.spike, sample - aligned, 0.0)
    x.gyro_rate = np.where(two, aligned + surprise, np.where(gyro, sample, x.rate))
    x.attitude = turned(x.attitude, np.where(two, turn + surprise * f.gyro_period_s / 2.0, turn_angular))
    x.attitude_angular = np.where(two, turned(x.attitude_angular, turn_angular), x.attitude)
    alone = ~two[:, 0]
    x.p[alone, DIFFERENCE, :] = x.p[alone, :, DIFFERENCE] = 0.0
    if (gyro & two).any():
        compare_attitudes(x, t, gyro & two)


def compare_rates(
    x: State, t: TurntableTuning, expected: FloatArray, lagged: FloatArray, age_s: FloatArray,
    gyro: BoolArray, angular: BoolArray, rest: bool,
) -> FloatArray:  # fmt: skip
    """Data layer: z = omega_gyro - omega_angular. Returns the correction of the angle, (runs, 3)."""
    f, share = t.fusion, gyro_share(t)
    used = gyro & ~x.gyro.spike
    z = x.gyro.value - expected * (1.0 + share * x.scale) - x.gyro_bias
    z = np.where(x.gyro.spike, 0.0, z)
    x.innovation = np.where(gyro, z, x.innovation)
    r = f.gyro_dps**2 / f.gyro_period_s
    h = np.zeros((len(x.p), 5))
    h[:, RATE], h[:, GYRO_BIAS], h[:, ANGULAR_BIAS] = 1.0, 1.0, age_s[:, 0]
    largest = np.max(np.minimum(np.abs(z), SHOCK_DPS), axis=1, keepdims=True) ** 2
    shock = gyro & (largest / SHOCK > np.einsum("ri,rij,rj->r", h, x.p, h)[:, None] + r)
    x.p[:, RATE, RATE] += np.where(shock, largest, 0.0)[:, 0]
    first, s = measure(x, h, r, gyro)
    gain = np.where(used[..., None], first[:, None, :], 0.0)
    if not rest:
        direct = np.stack([share * expected, -lagged], axis=-1)
        projected = np.einsum("ri,raik->rak", h, x.v) + direct
        x.v = x.v - gain[..., None] * projected[..., None, :]
        spread = s + np.sum(projected**2 * x.m, axis=-1)
        learning = (used & angular & ~shock)[..., None]
        second = np.where(learning, x.m * projected / spread[..., None], 0.0)
        x.m = np.maximum(x.m - second * projected * x.m, 0.0)
        gain = gain + np.einsum("raik,rak->rai", x.v, second)
        x.scale = np.clip(x.scale + second[..., 0] * z, -0.25, 0.25)
        x.lag_s = np.clip(x.lag_s + second[..., 1] * z, 0.0, 16.0 * t.period_s)
    correct(x, gain, z)
    return gain[..., ANGLE] * z if f.layer == "data" else np.zeros_like(z)


def compare_attitudes(x: State, t: TurntableTuning, gyro: BoolArray) -> None:
    """Attitude layer: z = psi_gyro - psi_angular corrects both."""
    walk = np.where(gyro[:, 0], t.fusion.gyro_dps**2 * t.fusion.gyro_period_s, 0.0)
    x.p[:, DIFFERENCE, DIFFERENCE] += walk
    x.p[:, ANGLE, DIFFERENCE] -= walk
    x.p[:, DIFFERENCE, ANGLE] -= walk
    h = np.zeros((len(x.p), 5))
    h[:, DIFFERENCE] = 1.0
    gain, _ = measure(x, h, STILL_DPS2 * t.period_s**2, gyro)
    z = rotation_deg(x.attitude_angular, x.attitude)
    x.innovation = np.where(gyro, z / t.period_s, x.innovation)
    correct(x, np.broadcast_to(gain[:, None], (len(gain), 3, 5)), z)
    x.gyro_rate = x.gyro_rate - gain[:, None, GYRO_BIAS] * z
    x.attitude = turned(x.attitude, gain[:, None, ANGLE] * z)
    x.attitude_angular = turned(x.attitude_angular, (gain[:, None, DIFFERENCE] + gain[:, None, ANGLE]) * z)


def run_control(
    tuning: TurntableTuning,
    raw: npt.ArrayLike,
    setpoint: npt.ArrayLike | None = None,
    *,
    gyro_phase_s: npt.ArrayLike | None = None,
    rule: Rule = "trapezium",
) -> dict[str, FloatArray]:
    """From counts to attitudes. raw: (steps, 6[, runs]); setpoint: unused; gyro_phase_s: (runs,), one for each run
    instead of the tuning's.

    Returns float arrays (steps[, runs]) by name: attitude_w .. attitude_z, and for axis 0, 1, 2: rate_dps_0 ..,
    rate_fused_dps, gyro_bias_dps, angular_bias_dps2, scale, lag_s.
    """
    counts = np.asarray(raw, np.float64)
    many = counts.reshape(len(counts), 6, -1)
    phase_s = tuning.fusion.gyro_phase_s if gyro_phase_s is None else np.asarray(gyro_phase_s, np.float64)
    x = start(tuning, np.broadcast_to(phase_s, many.shape[2:]))
    x.rule = rule
    rows = []
    for k in range(len(many)):
        step(x, tuning, many[k].T)
        rows.append(
            np.concatenate(
                [x.attitude, x.gyro_rate, x.rate, x.gyro_bias, x.angular_bias, x.scale, x.lag_s], axis=1
            )
        )  # fmt: skip
    columns = np.moveaxis(np.array(rows).reshape(len(counts), -1, 22), 2, 0)
    names = [f"attitude_{axis}" for axis in "wxyz"]
    for name in ("rate_dps", "rate_fused_dps", "gyro_bias_dps", "angular_bias_dps2", "scale", "lag_s"):
        names += [f"{name}_{axis}" for axis in range(3)]
    shape = (len(counts), *counts.shape[2:])
    return {name: np.ascontiguousarray(column).reshape(shape) for name, column in zip(names, columns, strict=True)}

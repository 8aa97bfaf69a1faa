"""The filter that fuses a gyro with an angular accelerometer in integers, written from
the pages of docs/reference/arithmetic; the functions have the names of firmware/core/fusion.c."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.fixed.trig import reciprocal
from plumb.kernels.integers import add_scaled, clamp, clz32, mul_shift, sat_i32

RATE, GYRO_BIAS, ANGULAR_BIAS, DIFFERENCE, ANGLE = ROWS = range(5)
STATES = range(4)
CELL_MAX, ANGLE_MAX, GAIN_MAX = 1 << 58, 1 << 61, 1 << 30

Covariance = list[list[int]]
"""Q64, the lower triangle of the four states, then the row of the angle, which has no variance."""


@dataclass(slots=True)
class Parameter:
    """A constant that the second stage estimates (scale or lag), with the sensitivities of rate, gyro bias, angular
    bias and angle to it."""

    variance_q60: int
    sensitivity_q28: list[int] = field(default_factory=lambda: [0, 0, 0, 0])


class Predict(NamedTuple):
    """Inputs of one step of the covariance. difference: the difference of the attitudes grows by rate and gyro
    bias, and the error of the angle by the gyro's bias."""

    angular: bool
    difference: bool
    rate_q64: int
    gyro_bias_q64: int
    angular_bias_q64: int


class Inverse(NamedTuple):
    """2^61 / the upper 31 bits of s, and the number of bits dropped."""

    y_q61: int
    exponent: int


def zeros() -> Covariance:
    return [[0] * (min(i, 3) + 1) for i in ROWS]


def cell(p: Covariance, i: int, j: int) -> int:
    """Row i, column j of the symmetric matrix, in any order."""
    return p[i][j] if i >= j else p[j][i]


def put(p: Covariance, i: int, j: int, value: int) -> None:
    if i >= j:
        p[i][j] = value
    else:
        p[j][i] = value


def isolate(p: Covariance, i: int, variance: int) -> None:
    """Make state i independent of all others and set its variance."""
    for j in ROWS:
        put(p, i, j, 0)
    p[i][i] = variance


def bound(p: Covariance) -> None:
    """Bring every cell within its limit."""
    for i in STATES:
        variance = p[i][i]
        if not 0 <= variance <= CELL_MAX:
            isolate(p, i, 0 if variance < 0 else CELL_MAX)
        for j in range(i + 1, 5):
            limit = ANGLE_MAX if j == ANGLE else CELL_MAX
            if not -limit <= p[j][i] <= limit:
                p[j][i] = 0


def couple(p: Covariance, i: int, k: int, shift: int, sign: int) -> None:
    """Add error k / 2^shift to error i (sign -1: subtract it)."""
    p[i][i] += sign * (cell(p, k, i) >> shift)
    for j in ROWS:
        if j != i:
            put(p, i, j, cell(p, i, j) + sign * (cell(p, k, j) >> shift))
    p[i][i] += sign * (cell(p, k, i) >> shift)


def predict(p: Covariance, step: Predict, dt_s_q32: int) -> None:
    """Propagate the covariance by one step, the row of the angle first."""
    for j in STATES:
        if step.difference:
            p[ANGLE][j] -= mul_shift(cell(p, GYRO_BIAS, j), dt_s_q32, 32)
        else:
            p[ANGLE][j] += mul_shift(cell(p, RATE, j), dt_s_q32, 32)
    if step.difference:
        couple(p, DIFFERENCE, RATE, 0, 1)
        couple(p, DIFFERENCE, GYRO_BIAS, 0, 1)
    if step.angular:
        couple(p, RATE, ANGULAR_BIAS, 2, -1)
    p[RATE][RATE] += step.rate_q64
    p[GYRO_BIAS][GYRO_BIAS] += step.gyro_bias_q64
    p[ANGULAR_BIAS][ANGULAR_BIAS] += step.angular_bias_q64
    bound(p)


def project_rate(p: Covariance, age_q24: int) -> tuple[list[int], int]:
    """Covariance of all rows with a gyro measurement, u = P h, and its variance, at least 0."""
    u = [
        cell(p, i, RATE) + cell(p, i, GYRO_BIAS) + mul_shift(cell(p, i, ANGULAR_BIAS), age_q24, 26) for i in ROWS
    ]  # fmt: skip
    return u, max(u[RATE] + u[GYRO_BIAS] + mul_shift(u[ANGULAR_BIAS], age_q24, 26), 0)


def project_state(p: Covariance, state: int) -> tuple[list[int], int]:
    """Covariance of all rows with one state as the measurement, and its variance."""
    u = [cell(p, i, state) for i in ROWS]
    return u, u[state]


def inverse(s_q64: int) -> Inverse:
    n = clz32(s_q64 >> 32) - 1
    return Inverse(reciprocal((s_q64 << n) >> 32), 32 - n)


def ratio(u: int, y_q61: int, shift: int) -> int:
    """u / s by the reciprocal y of s; shift brings u to the format of the gain."""
    return (sat_i32(u >> shift) * y_q61) >> 31


def gains(u_q64: Sequence[int], s_q64: int) -> list[int]:
    """u / s in Q28 for every row, saturated to +-4."""
    y = inverse(s_q64)
    return [clamp(ratio(u, y.y_q61, y.exponent + 2), -GAIN_MAX, GAIN_MAX) for u in u_q64]


def update(p: Covariance, gain_q28: Sequence[int], u_q64: Sequence[int]) -> None:
    """P = P - gain u^T."""
    for row, gain in zip(p, gain_q28, strict=True):
        if gain:
            for j in range(len(row)):
                row[j] -= mul_shift(u_q64[j], gain, 28)
    bound(p)


def parameter_predict(a: Parameter, angular: bool, drive_q28: int, dt_s_q32: int) -> None:
    """Propagate the sensitivities by one step. drive_q28: effect of the parameter on the rate in this step."""
    v = a.sensitivity_q28
    v[3] = add_scaled(v[3], v[RATE], dt_s_q32, 32)
    lost = v[ANGULAR_BIAS] >> 2 if angular else 0
    v[RATE] = sat_i32(v[RATE] + drive_q28 - lost)


def parameter_project(a: Parameter, age_q24: int, direct_q28: int, limit_q28: int) -> int:
    """Sensitivity of the innovation to the parameter, clamped to +-limit. direct: what does not act through the
    states."""
    v = a.sensitivity_q28
    through = sat_i32(v[RATE] + v[GYRO_BIAS] + direct_q28)
    return clamp(add_scaled(through, v[ANGULAR_BIAS], age_q24, 26), -limit_q28, limit_q28)


def parameter_update(a: Parameter, gain_q28: Sequence[int], projected_q28: int) -> None:
    """Update the sensitivities by a measurement, with the gains of the first stage."""
    v = a.sensitivity_q28
    v[0] = add_scaled(v[0], gain_q28[RATE], -projected_q28, 28)
    v[1] = add_scaled(v[1], gain_q28[GYRO_BIAS], -projected_q28, 28)
    v[2] = add_scaled(v[2], gain_q28[ANGULAR_BIAS], -projected_q28, 28)
    v[3] = add_scaled(v[3], gain_q28[ANGLE], -projected_q28, 28)


def parameter_cross(a: Parameter, projected_q28: int) -> int:
    """Covariance of the parameter with the innovation, Q60."""
    return mul_shift(a.variance_q60, projected_q28, 28)


def parameter_learn(a: Parameter, cross_q60: int, y: Inverse, gain_q28: list[int]) -> int:
    """Update the parameter's variance by an innovation; returns the parameter's gain, Q20. Adds to gain_q28 the part
    that the states get through the sensitivities."""
    learnt_q20 = ratio(cross_q60, y.y_q61, y.exponent + 6)
    a.variance_q60 = max(a.variance_q60 - mul_shift(cross_q60, learnt_q20, 20), 0)
    v = a.sensitivity_q28
    gain_q28[RATE] = add_scaled(gain_q28[RATE], v[0], learnt_q20, 20)
    gain_q28[GYRO_BIAS] = add_scaled(gain_q28[GYRO_BIAS], v[1], learnt_q20, 20)
    gain_q28[ANGULAR_BIAS] = add_scaled(gain_q28[ANGULAR_BIAS], v[2], learnt_q20, 20)
    gain_q28[ANGLE] = add_scaled(gain_q28[ANGLE], v[3], learnt_q20, 20)
    return learnt_q20


RANGES = {
    "layer": (0, 2), "dt_s_q32": (1, 1 << 26), "step_hz_q16": (1, (1 << 31) - 1),
    "gyro_period_step_q24": (1 << 24, 1 << 28), "gyro_samples_step_q30": (1 << 26, 1 << 30),
    "lag_step_q24": (0, 1 << 28), "lag_alpha_q31": (0, (1 << 31) - 1), "share_q30": (0, 1 << 30),
    "r_gyro_q44": (1 << 12, (1 << 32) - 1), "v_lag_q30": (0, 1 << 30),
}  # fmt: skip


def valid(p: Params) -> bool:
    """Whether the arithmetic is made for these words."""
    ranges = all(low <= p[f"fusion.{name}"] <= high for name, (low, high) in RANGES.items())
    return ranges and p["fusion.gyro_age_step_q24"] < p["fusion.gyro_period_step_q24"]

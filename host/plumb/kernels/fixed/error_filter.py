"""The filter of ten errors in integers: bias and scale of the gyro, tilt, horizontal velocity. Written from
docs/reference/arithmetic/attitude.md; the functions have the names of firmware/core/error_filter.c."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from plumb.kernels.fixed.trig import reciprocal
from plumb.kernels.integers import INT32_MAX, clamp, clz32, mulhi_i32, mulhi_near, wrap_i32, wrap_u32

BIAS, SCALE, TILT, VELOCITY, STATES = 0, 3, 6, 8, 10
VARIANCE_LIMIT_Q32 = 858993459
INNOVATION_LIMIT_Q28 = (1 << 28) - 1
GATE = 25


def triangle() -> list[list[int]]:
    """A lower triangle: row i has the columns 0 to i."""
    return [[0] * (i + 1) for i in range(STATES)]


@dataclass(slots=True)
class ErrorFilter:
    covariance_q32: list[list[int]] = field(default_factory=triangle)
    correction_q28: list[int] = field(default_factory=lambda: [0] * STATES)
    gain_q28: list[int] = field(default_factory=lambda: [0] * STATES)
    measured_row_q32: list[int] = field(default_factory=lambda: [0] * STATES)
    coupling_q32: list[list[int]] = field(default_factory=lambda: [[0] * 6, [0] * 6])
    half_lever_q32: int = 0
    tilt_growth_q32: int = 0
    velocity_growth_q32: int = 0

    def variance(self, state: int) -> int:
        """Unsigned."""
        return wrap_u32(self.covariance_q32[state][state])


def add(to: list[int], at: int, by: int) -> None:
    """Add to an entry of the covariance or to a correction, modulo 2^32."""
    to[at] = wrap_i32(to[at] + by)


def weighted(by: Sequence[int], of: Sequence[int]) -> int:
    """Sum of the products of six, each Q32 and rounded to nearest."""
    total = 0
    for i in range(6):
        total += mulhi_near(by[i], of[i])
    return total


def start(bias: int, scale: int, tilt: int, velocity: int) -> ErrorFilter:
    """With these variances, and without corrections."""
    e = ErrorFilter()
    for i in range(3):
        e.covariance_q32[BIAS + i][BIAS + i] = bias
        e.covariance_q32[SCALE + i][SCALE + i] = scale
    for i in range(2):
        e.covariance_q32[TILT + i][TILT + i] = tilt
        e.covariance_q32[VELOCITY + i][VELOCITY + i] = velocity
    return e


def predict(e: ErrorFilter) -> None:
    """Propagate the corrections over a block: velocity by tilt, tilt by bias and scale."""
    by, lever = e.correction_q28, e.half_lever_q32
    add(by, VELOCITY, mulhi_near(lever, by[TILT + 1]))
    add(by, VELOCITY + 1, -mulhi_near(lever, by[TILT]))
    add(by, TILT, weighted(e.coupling_q32[0], by))
    add(by, TILT + 1, weighted(e.coupling_q32[1], by))
    add(by, VELOCITY, mulhi_near(lever, by[TILT + 1]))
    add(by, VELOCITY + 1, -mulhi_near(lever, by[TILT]))


def grow_velocity(e: ErrorFilter) -> None:
    """Propagate the errors of the velocity by those of the tilt, over half the lever of the block."""
    lever = e.half_lever_q32
    tilt_x, tilt_y = e.covariance_q32[TILT], e.covariance_q32[TILT + 1]
    x, y = e.covariance_q32[VELOCITY], e.covariance_q32[VELOCITY + 1]
    for i in range(TILT):
        add(x, i, mulhi_near(lever, tilt_y[i]))
        add(y, i, -mulhi_near(lever, tilt_x[i]))
    x_by_y, y_by_x, y_by_y = x[TILT + 1], y[TILT], y[TILT + 1]
    add(x, TILT, mulhi_near(lever, tilt_y[TILT]))
    add(x, TILT + 1, mulhi_near(lever, tilt_y[TILT + 1]))
    add(y, TILT, -mulhi_near(lever, tilt_x[TILT]))
    add(y, TILT + 1, -mulhi_near(lever, tilt_y[TILT]))
    add(x, VELOCITY, mulhi_near(lever, wrap_i32(x_by_y + x[TILT + 1])))
    add(y, VELOCITY, mulhi_near(lever, y_by_y) - mulhi_near(lever, x[TILT]))
    add(y, VELOCITY + 1, -mulhi_near(lever, wrap_i32(y_by_x + y[TILT])))


def grow_tilt(e: ErrorFilter, axis: int) -> None:
    """Propagate the error of one component of the tilt by the errors of the gyro, times the coupling."""
    covariance, coupling = e.covariance_q32, e.coupling_q32[axis]
    own, other = covariance[TILT + axis], covariance[TILT + 1 - axis]
    x, y = covariance[VELOCITY], covariance[VELOCITY + 1]
    grown = []
    for i in range(6):
        row = [covariance[max(i, j)][min(i, j)] for j in range(6)]
        grown.append(wrap_i32(own[i] + weighted(coupling, row)))
    add(covariance[TILT + 1], TILT, weighted(coupling, other))
    add(x, TILT + axis, weighted(coupling, x))
    add(y, TILT + axis, weighted(coupling, y))
    add(own, TILT + axis, weighted(coupling, own) + weighted(coupling, grown))
    own[:6] = grown


def grow(e: ErrorFilter, bias_growth_q32: int, scale_growth_q32: int) -> None:
    """Propagate the velocity again, add the growth to every variance, and clear the corrections."""
    grow_velocity(e)
    growths = [bias_growth_q32] * 3 + [scale_growth_q32] * 3 + [e.tilt_growth_q32] * 2 + [e.velocity_growth_q32] * 2
    for i, growth in enumerate(growths):
        if e.covariance_q32[i][i] < VARIANCE_LIMIT_Q32:
            add(e.covariance_q32[i], i, growth)
        e.correction_q28[i] = 0


def weigh(e: ErrorFilter, at: int, variance_q32: int, measured_q28: int) -> None:
    """Gains and corrections of one scalar measurement: the error of state `at` is measured_q28. A bias beyond five
    sigma is ignored."""
    covariance = e.covariance_q32
    e.measured_row_q32 = [covariance[max(i, at)][min(i, at)] for i in range(STATES)]

    exact = wrap_u32(e.measured_row_q32[at]) + variance_q32
    coarse = 4 if exact > 0xFFFFFFFF else 0
    total = max(exact >> coarse, 1)
    innovation = wrap_i32(measured_q28 - e.correction_q28[at])
    innovation = clamp(innovation, -INNOVATION_LIMIT_Q28, INNOVATION_LIMIT_Q28)
    n, one = clz32(total), 2 + coarse
    shift = max(n - one, 0)
    inverse = reciprocal((total << n) >> 1) >> max(one - n, 0)
    if at < SCALE and (innovation * innovation) >> 24 > GATE * total:
        inverse = 0
    limit = INT32_MAX >> shift
    for i, row in enumerate(e.measured_row_q32):
        gain_q28 = clamp(mulhi_i32(row, inverse), -limit, limit) << shift
        e.gain_q28[i] = gain_q28
        add(e.correction_q28, i, 16 * mulhi_near(gain_q28, innovation))


def shrink(e: ErrorFilter) -> None:
    """Subtract gain times row from the covariance, after that measurement."""
    for row, gain_q28 in zip(e.covariance_q32, e.gain_q28, strict=True):
        for j in range(len(row)):
            row[j] = wrap_i32(row[j] - 16 * mulhi_near(gain_q28, e.measured_row_q32[j]))

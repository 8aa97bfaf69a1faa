"""Plausibility of the sensors and readiness for arming in integers, written from docs/explanation/sensors.md and
docs/reference/arithmetic/plausibility.md: the results of plumb_plausibility_step for the record of a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from plumb.kernels.integers import clamp, wrap_i32

ACCEL, INNOVATION, RATE = 1, 2, 4
SETTLING, MOVING, CONVERGING, SETPOINT, TILTED = 1, 2, 4, 8, 16
ANGLE_MAX = 178956971
"""15 deg, turn Q32: limit of the innovation, and of the mismatch."""
CENTRED_MAX = 35791394
"""3 deg, turn Q32."""
QUARTER_TURN = 1 << 30
UPRIGHT_MAX = 715827882
"""60 deg, turn Q32."""
MEAN_MAX = 1 << 29


def _time_q33(ms: int) -> int:
    return (ms << 33) // 1000


class Bounds(NamedTuple):
    """Plausibility bounds of a system. setpoint, accel: names of words of its record;
    setpoint_max: the most of the setpoint at rest; *_g2_q20: squared acceleration,
    g^2 Q20; rest_turnps_q28, uneven_turn_q32, ready_turn_q32: bounds of the mean rate at rest, of the mean difference
    between both sensors' turns in a step, and of the tilt at which the system may be armed. doubts: the measured tilt
    is the estimate while the step does not believe the accelerometer."""

    setpoint: str
    accel: tuple[str, str]
    accel_g2_q20: tuple[int, int]
    rest_g2_q20: tuple[int, int]
    rest_turnps_q28: int
    uneven_turn_q32: int
    ready_turn_q32: int
    setpoint_max: int = 0
    doubts: bool = False


@dataclass(slots=True)
class State:
    """The words of a step's record of plausibility, in order."""

    accel_s_q33: int = 0
    innovation_s_q33: int = 0
    rate_s_q33: int = 0
    converged_s_q33: int = 0
    ready_s_q33: int = 0
    mismatch_turn_q32: int = 0
    unevenness_turn_q32: int = 0
    measured_turn_q32: int = 0
    rate_turnps_q28: int = 0
    innovation_turn_q32: int = 0
    rate_mean_turnps_q28: int = 0
    accel_mean_g2_q20: int = 1 << 20
    begun: int = 0
    converged: int = 0
    failed: int = 0
    missing: int = 31

    def words(self) -> tuple[int, ...]:
        return tuple(getattr(self, name) for name in State.__slots__)


def _lasts(now: int, met: bool, dt: int, limit: int) -> int:
    """Counts up while the condition is met, at most a step beyond its limit, and down while it is not."""
    return min(now + dt, limit + dt) if met else max(now - dt, 0)


def _holds(now: int, met: bool, dt: int, limit: int) -> int:
    return min(now + dt, limit) if met else 0


def _mean(of: int, value: int, share: int) -> int:
    return of + ((clamp(value, -MEAN_MAX, MEAN_MAX) - of) * share >> 32)


def step(s: State, b: Bounds, word: Mapping[str, int], dt: int, unit_turn2_q56: int) -> None:
    """One step. word: its record by name; dt: the period, Q33; unit_turn2_q56: value of
    2^32 lsb of variance, 0 if it is not known."""
    share = 2 * dt
    measured, rate, innovation = word["tilt_measured_turn_q32"], word["rate_turnps_q28"], word["innovation_turn_q32"]
    force = sum(word[name] ** 2 for name in b.accel) >> 32
    before, rate_before = (s.measured_turn_q32, s.rate_turnps_q28) if s.begun else (measured, rate)
    s.begun = 1
    turned = wrap_i32(measured - before) - (((rate_before >> 1) + (rate >> 1)) * dt >> 29)
    mismatch = clamp(s.mismatch_turn_q32 + turned, -QUARTER_TURN, QUARTER_TURN)
    s.mismatch_turn_q32 = mismatch - (mismatch * share >> 32)
    s.unevenness_turn_q32 = _mean(s.unevenness_turn_q32, min(abs(wrap_i32(turned)), MEAN_MAX), share)
    s.measured_turn_q32, s.rate_turnps_q28 = measured, rate
    s.innovation_turn_q32 = _mean(s.innovation_turn_q32, innovation, share)
    s.rate_mean_turnps_q28 = _mean(s.rate_mean_turnps_q28, min(abs(word["rate_corrected_turnps_q28"]), MEAN_MAX), share)
    s.accel_mean_g2_q20 = _mean(s.accel_mean_g2_q20, min(force, MEAN_MAX), share)

    time = _time_q33(300)
    s.converged_s_q33 = _holds(s.converged_s_q33, abs(s.innovation_turn_q32) <= CENTRED_MAX, dt, time)
    s.converged = int(bool(s.converged) or s.converged_s_q33 >= time)

    odd = not b.accel_g2_q20[0] <= force <= b.accel_g2_q20[1]
    s.accel_s_q33 = _lasts(s.accel_s_q33, odd, dt, _time_q33(200))
    odd = bool(s.converged) and abs(innovation) > ANGLE_MAX and _above_six_sigma(word, innovation, unit_turn2_q56)
    early = 4 * dt if (word["k0_q29"] & 0xFFFFFFFF) > dt >> 3 else dt
    s.innovation_s_q33 = _lasts(s.innovation_s_q33, odd, early, time)
    odd = abs(s.mismatch_turn_q32) > ANGLE_MAX or abs(s.unevenness_turn_q32) > b.uneven_turn_q32
    odd = odd or (b.doubts and word[b.accel[1]] < 0 and abs(word["tilt_turn_q32"]) < UPRIGHT_MAX)
    s.rate_s_q33 = _lasts(s.rate_s_q33, odd, dt, _time_q33(120))
    s.failed = (
        (ACCEL if s.accel_s_q33 >= _time_q33(200) else 0)
        | (INNOVATION if s.innovation_s_q33 >= time else 0)
        | (RATE if s.rate_s_q33 >= _time_q33(120) else 0)
    )
    _missing(s, b, word, dt)


def _above_six_sigma(word: Mapping[str, int], innovation: int, unit: int) -> bool:
    """innovation^2 > 36 R / (1 - k0), both sides times 1 - k0."""
    square = min(abs(innovation), (1 << 31) - 1) ** 2 >> 30
    rest = (1 << 29) - min(word["k0_q29"] & 0xFFFFFFFF, 1 << 29)
    return (square & 0xFFFFFFFF) * rest >> 7 > (36 * word["variance"] & 0xFFFFFFFF) * unit


def _missing(s: State, b: Bounds, word: Mapping[str, int], dt: int) -> None:
    still = abs(s.rate_mean_turnps_q28) <= b.rest_turnps_q28
    still = still and b.rest_g2_q20[0] <= abs(s.accel_mean_g2_q20) <= b.rest_g2_q20[1]
    settled = bool(s.converged) and s.converged_s_q33 >= _time_q33(300)
    bits = (0 if still else MOVING) | (0 if settled else CONVERGING)
    bits |= (0 if abs(word[b.setpoint]) <= b.setpoint_max else SETPOINT) | (
        0 if abs(word["tilt_turn_q32"]) <= b.ready_turn_q32 else TILTED
    )
    s.ready_s_q33 = _holds(s.ready_s_q33, bits == 0, dt, _time_q33(300))
    s.missing = bits | (0 if s.ready_s_q33 >= _time_q33(300) else SETTLING)

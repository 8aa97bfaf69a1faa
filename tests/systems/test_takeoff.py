"""The conditions for a takeoff: the C of firmware/core and the integers of the package agree on records of any value,
and each condition is asked for at its limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.kernels.fixed import takeoff
from plumb.kernels.fixed.takeoff import CONVERGING, MOVING, SETPOINT, SETTLING, TILTED
from plumb.spec.records import RECORDS, Words
from plumb.systems.quadrotor.fixed import LANDED, TAKEOFF

PARAMS = quantise(systems.load("quadrotor").TUNINGS["hummingbird"])
DT_S_Q33 = round(PARAMS.period_s * 2**33)
READY_STEPS = math.ceil(0.3 / PARAMS.period_s)
DPS, G_UP = 2**28 / 360.0, 2**30
Rows = np.ndarray[tuple[int], np.dtype[np.void]]


def at_rest(steps: int) -> Rows:
    """A vehicle that stands level, its attitude known, the throttle low."""
    rows = np.zeros(steps, RECORDS["quadrotor"])
    rows["up_q30_2"], rows["flags"] = G_UP, LANDED
    return rows


def missing(rows: Rows) -> list[int]:
    return [int(bits) for bits in native_core.takeoff(PARAMS, Words(rows), DT_S_Q33)[:, 2]]


def test_standing_still_for_300_ms_is_ready() -> None:
    bits = missing(at_rest(2 * READY_STEPS))
    assert bits[: READY_STEPS - 1] == [SETTLING] * (READY_STEPS - 1)
    assert bits[READY_STEPS:] == [0] * READY_STEPS


@pytest.mark.parametrize(
    ("word", "within", "beyond", "bit"),
    [
        ("setpoint_throttle_q15", 0.05 * 32767, 0.051 * 32767, SETPOINT),
        ("rate_turnps_q28_0", 4.9 * DPS, 5.1 * DPS, MOVING),
        ("rate_turnps_q28_1", -4.9 * DPS, -5.1 * DPS, MOVING),
        ("rate_turnps_q28_2", 4.9 * DPS, 5.1 * DPS, MOVING),
        ("up_q30_2", math.cos(math.radians(24.9)) * G_UP, math.cos(math.radians(25.1)) * G_UP, TILTED),
        ("up_q30_2", G_UP, -G_UP, TILTED),
        ("tilt_variance_rad2_q32", math.radians(2.9) ** 2 * 2**32, math.radians(3.1) ** 2 * 2**32, CONVERGING),
        ("tilt_variance_rad2_q32", 0, 2**32 - 1, CONVERGING),
        ("flags", ~0b111 & 0xFFF, LANDED | 0b001, MOVING),  # a gyro at its limit
        ("flags", LANDED, LANDED | 0b010, MOVING),  # an accelerometer at its limit
        ("flags", LANDED, LANDED | 0b100, MOVING),  # no sample
        ("flags", LANDED, 0x7F8, MOVING),  # in the air, or falling
    ],
)
def test_each_condition_is_asked_for_at_its_limit(word: str, within: float, beyond: float, bit: int) -> None:
    rows = at_rest(1000)
    rows[word] = round(within)
    assert missing(rows)[-1] == 0
    rows[word][600:] = round(beyond)
    assert missing(rows)[-1] == bit | SETTLING
    rows[word][800:] = round(within)
    assert missing(rows)[800 + READY_STEPS // 2] & SETTLING, "again for 300 ms"


@pytest.mark.parametrize("seed", range(8))
def test_both_implementations_agree_on_words_of_any_value(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, steps = at_rest(400), 400
    for axis in range(3):
        rows[f"rate_turnps_q28_{axis}"] = rng.integers(-(2**31), 2**31, steps) >> rng.integers(0, 30, steps)
    rows["up_q30_2"] -= rng.integers(0, 2**32 - 1, steps) >> rng.integers(1, 31, steps)
    rows["tilt_variance_rad2_q32"] = rng.integers(0, 2**32, steps) >> rng.integers(0, 32, steps)
    rows["flags"] = rng.integers(0, 2**12, steps) * rng.integers(0, 2, steps)
    rows["setpoint_throttle_q15"] = rng.integers(-(2**31), 2**31, steps) >> rng.integers(0, 31, steps)
    calm = rng.integers(0, 2, steps // 50).repeat(50).astype(bool)  # a while at rest
    rows[calm] = at_rest(steps)[calm]
    for dt in (DT_S_Q33, 1, round(0.1 * 2**33)):
        state, expected = takeoff.State(), []
        for row in rows:
            takeoff.step(state, TAKEOFF, {name: int(row[name]) for name in row.dtype.names or ()}, dt)
            expected.append(state.words())
        assert native_core.takeoff(PARAMS, Words(rows), dt).tolist() == [list(words) for words in expected]


def test_a_system_on_the_ground_has_no_takeoff() -> None:
    other = quantise(systems.load("quad").TUNINGS["hold"])
    with pytest.raises(UsageError, match="quad does not fly"):
        native_core.takeoff(other, Words(np.zeros(1, RECORDS["quad"])), 1)

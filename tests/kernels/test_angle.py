"""Angles, sines and lengths: their error against float64, their symmetry, and the corners of int32."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.kernels.fixed import trig
from plumb.proof import accuracy
from support.each_run import each

QUARTER, HALF = 1 << 30, 1 << 31
INT32_MIN, INT32_MAX = -(1 << 31), (1 << 31) - 1


def vectors(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions all round, lengths from 2^8 to 2^31: shorter vectors have fewer directions, not more error."""
    length, phi = 2.0 ** rng.uniform(8, 31, n), rng.uniform(-np.pi, np.pi, n)
    return tuple(np.rint(length * f(phi)).astype(np.int64).clip(INT32_MIN, INT32_MAX) for f in (np.sin, np.cos))  # type: ignore[return-value]


def test_atan2_is_within_5e_6_deg() -> None:
    y, x = vectors(np.random.default_rng(1), 2_000_000)
    assert np.abs(accuracy.atan2_error_deg(y, x)).max() < 5e-6


def test_atan2_around_the_eighths_of_the_turn() -> None:
    """Where the octants meet, and next to the axes."""
    base = np.array([1 << 10, 12345, 1 << 20, 99999999, 1 << 30, INT32_MAX - 4])
    near = (base[:, None] + np.arange(-4, 5)).ravel()
    y, x = np.meshgrid(np.concatenate([near, -near, np.arange(-4, 5)]), np.concatenate([near, -near, np.arange(-4, 5)]))
    some = (y != 0) | (x != 0)
    assert np.abs(accuracy.atan2_error_deg(y[some], x[some])).max() < 5e-6


def test_atan2_is_symmetric() -> None:
    """In y exactly; in x and across the diagonal as binary angles, wherever the mirror image is another int32."""
    y, x = vectors(np.random.default_rng(3), 200_000)
    keep = (np.abs(y) < INT32_MAX) & (np.abs(x) < INT32_MAX) & (y != 0) & (x != 0) & (np.abs(y) != np.abs(x))
    y, x = y[keep], x[keep]
    turn = native_core.atan2(y, x).astype(np.int64)
    assert np.array_equal(native_core.atan2(-y, x), -turn)
    assert np.array_equal((native_core.atan2(y, -x) + turn - HALF) % (2 * HALF), np.zeros_like(turn))
    first = (y > 0) & (x > 0)
    assert np.array_equal(native_core.atan2(x[first], y[first]), QUARTER - turn[first])


@pytest.mark.parametrize("atan2", [trig.atan2, native_core.atan2])
@pytest.mark.parametrize(
    ("y", "x", "turn"),
    [
        (0, 0, 0),
        (0, 1, 0),
        (0, INT32_MAX, 0),
        (1, 0, QUARTER),
        (-1, 0, -QUARTER),
        (INT32_MIN, 0, -QUARTER),
        (0, -1, -HALF),
        (0, INT32_MIN, -HALF),
    ],
)
def test_atan2_on_the_axes(atan2: object, y: int, x: int, turn: int) -> None:
    assert callable(atan2)
    assert int(np.ravel(atan2(y, x))[0]) == turn


@pytest.mark.parametrize(("y", "x", "deg"), [(INT32_MIN, INT32_MIN, -135), (INT32_MIN, INT32_MAX, -45)])
def test_atan2_of_the_most_negative(y: int, x: int, deg: float) -> None:
    assert native_core.atan2([y], [x])[0] * accuracy.TURN_DEG == pytest.approx(deg, abs=5e-6)


def test_asin_is_within_1e_5_deg_up_to_the_ends() -> None:
    rng = np.random.default_rng(4)
    x = rng.integers(-QUARTER, QUARTER + 1, 2_000_000)
    ends = QUARTER - (rng.integers(0, QUARTER, 1_000_000) >> rng.integers(0, 30, 1_000_000))
    assert np.abs(accuracy.asin_error_deg(x)).max() < 1e-5
    assert np.abs(accuracy.asin_error_deg(np.concatenate([ends, -ends]))).max() < 1e-5


def test_asin_is_odd_and_saturates() -> None:
    x = np.random.default_rng(5).integers(0, QUARTER, 200_000)
    assert np.array_equal(native_core.asin(-x), -native_core.asin(x))
    beyond = np.array([QUARTER, QUARTER + 1, INT32_MAX, -QUARTER, -QUARTER - 1, INT32_MIN, 0])
    assert native_core.asin(beyond).tolist() == [QUARTER] * 3 + [-QUARTER] * 3 + [native_core.asin([0])[0]]
    # Level: 5 of 2^32 of a turn are 4e-7 deg, a twentieth of what asin may be wrong elsewhere.
    assert abs(int(native_core.asin([0])[0])) <= 5


def test_asin_never_turns_back() -> None:
    """Monotonic on a grid of 1e-6 of its range: a controller never sees the wrong direction."""
    x = np.arange(-QUARTER, QUARTER, 997)
    assert np.diff(native_core.asin(x).astype(np.int64)).min() >= 0


def test_reciprocal_is_within_its_stated_error() -> None:
    d = np.random.default_rng(6).integers(1 << 30, 1 << 31, 1_000_000)
    y = native_core.reciprocal(d).astype(np.float64)
    relative = y / (2.0**61 / d) - 1.0
    assert relative.min() > -(2.0**-28.3) and (y - 2.0**61 / d).max() <= 3.0 and y.max() < 2**31


def all_round(seed: int, n: int) -> np.ndarray:
    """Binary angles everywhere, and within 4 units of every eighth of a turn."""
    anywhere = np.random.default_rng(seed).integers(INT32_MIN, INT32_MAX + 1, n)
    eighths = (np.arange(-4, 4)[:, None] * (1 << 29) + np.arange(-4, 5)).ravel()
    return np.concatenate([anywhere, eighths[eighths >= INT32_MIN]])


def test_sine_and_cosine_are_within_8e_9() -> None:
    assert accuracy.sincos_error(all_round(7, 2_000_000)).max() < 8e-9


def test_sine_and_cosine_never_leave_one_and_meet_it_at_the_quarters() -> None:
    sine, cosine = native_core.sincos(all_round(8, 500_000))
    assert max(np.abs(sine).max(), np.abs(cosine).max()) == QUARTER
    quarters = [(0, 0, QUARTER), (QUARTER, QUARTER, 0), (-HALF, 0, -QUARTER), (-QUARTER, -QUARTER, 0)]
    for turn, sine_q30, cosine_q30 in quarters:
        assert [int(value[0]) for value in native_core.sincos([turn])] == [sine_q30, cosine_q30]


def test_a_quarter_turn_makes_a_sine_of_a_cosine() -> None:
    turn = all_round(9, 200_000)
    sine, cosine = native_core.sincos(turn)
    later_sine, later_cosine = native_core.sincos((turn + QUARTER + HALF) % (2 * HALF) - HALF)
    assert np.array_equal(later_sine, cosine) and np.array_equal(later_cosine, -sine)


def test_length_is_within_6e_9_of_itself_and_a_unit() -> None:
    rng = np.random.default_rng(10)
    size = 2.0 ** rng.uniform(0, np.log2(7.0 * 2**28), (2, 1_000_000))
    y, x = np.rint(size * rng.choice([-1.0, 1.0], size.shape)).astype(np.int64)
    half = np.hypot(y.astype(np.float64), x.astype(np.float64)) / 2.0
    assert np.all(np.abs(native_core.length(y, x) - half) <= 6e-9 * half + 1.0)


def test_length_of_nothing_and_of_the_longest() -> None:
    most = 7 << 28
    assert native_core.length([0, 1, 0, 2], [0, 0, -2, 0]).tolist() == [0, 0, 1, 1]
    assert int(native_core.length([most], [-most])[0]) == pytest.approx(most / np.sqrt(2.0), rel=6e-9)


def test_both_hands_agree_on_sine_cosine_and_length() -> None:
    turn = all_round(11, 20_000)
    assert np.array_equal(each(trig.sincos, turn), native_core.sincos(turn))
    y, x = np.random.default_rng(12).integers(-(7 << 28), 7 << 28, (2, 20_000)) >> np.arange(20_000) % 31
    assert np.array_equal(each(trig.length, y, x), native_core.length(y, x))

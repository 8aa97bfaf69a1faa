"""Intervals, differences and effects against what is known of the numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from plumb.campaign import against, statistics
from plumb.campaign.batch import Batch
from plumb.campaign.results import Results
from plumb.errors import UsageError
from plumb.proof import intervals


def results(values: np.ndarray, seeds: range, **factors: list[Any]) -> Results:
    count = len(values)
    metrics: dict[str, list[float | None]] = {"error_deg": [None if np.isnan(one) else float(one) for one in values]}
    indices = list(range(count))
    return Results([Batch({}, indices, list(seeds), [1] * count, [0] * count, [None] * count, factors, metrics)])


def test_the_interval_is_that_of_the_mean() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 1000)
    low, high = intervals.of_mean(values)
    half = 1.96 * values.std(ddof=1) / np.sqrt(1000)
    assert low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert high == pytest.approx(values.mean() + half, abs=0.1 * half)


def test_the_interval_has_the_mean_of_all_seeds_in_most_campaigns() -> None:
    rng = np.random.default_rng(2)
    held = sum(low <= 1.0 <= high for low, high in (intervals.of_mean(rng.exponential(1.0, 60)) for _ in range(100)))
    # 95 of 100 with a standard deviation of 2.2, and some less for so skew a distribution: four of them below.
    assert 86 <= held <= 99


def test_what_is_drawn_at_once_is_what_is_drawn_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """The bits of a printed interval do not depend on how many resamples memory has room for."""
    values = np.random.default_rng(4).normal(5.0, 2.0, (2, 40))
    at_once = intervals.of_mean(values[0]), intervals.share(values[0], values[1])
    for rows in (1, 7):
        monkeypatch.setattr(intervals, "AT_ONCE", rows * 40)
        assert (intervals.of_mean(values[0]), intervals.share(values[0], values[1])) == at_once


def test_runs_without_the_figure_are_not_counted() -> None:
    found = statistics.figures(results(np.array([1.0, np.nan, 3.0]), range(3)))["error_deg"]
    assert (found.mean, found.runs, found.max, found.worst_index) == (2.0, 2, 3.0, 2)


def test_a_difference_below_the_spread_is_found_by_pairs() -> None:
    noise = np.random.default_rng(3).normal(0.0, 1.0, 400)
    here, other = results(noise + 0.02, range(400)), results(noise[:300], range(300))
    (found,) = against.compare(here, other)
    assert found.pairs == 300 and found.real and found.difference == pytest.approx(0.02)
    (same,) = against.compare(results(noise, range(400)), results(np.roll(noise, 1), range(400)))
    assert not same.real
    with pytest.raises(UsageError, match="no seed in common"):
        against.compare(here, results(noise, range(1000, 1400)))


def test_the_share_of_the_runs_that_keep_a_limit() -> None:
    (found,) = statistics.shares(results(np.array([1.0] * 95 + [3.0] * 4 + [np.nan]), range(100)), {"error_deg": 2.0})
    assert (found.kept, found.runs) == (95, 100)
    assert (round(found.low, 3), round(found.high, 3)) == (0.888, 0.978)
    with pytest.raises(
        UsageError, match=r"limits.error: no run has it .did you mean error_deg\?.; there are error_deg"
    ):
        statistics.shares(results(np.array([1.0]), range(1)), {"error": 2.0})


def test_the_factor_that_moves_a_figure_is_named() -> None:
    rng = np.random.default_rng(4)
    delay_ms, other = rng.uniform(0.0, 10.0, 800), [f"{one}" for one in rng.integers(0, 4, 800)]
    values = delay_ms**2 + rng.normal(0.0, 3.0, 800)
    found = statistics.effects(results(values, range(800), delay_ms=delay_ms.tolist(), other=other), ["error_deg"])
    assert [one.factor for one in found] == ["delay_ms", "other"]
    # The delay makes 889 of a variance of 898; of a factor that does nothing chance makes 3 / 800 = 0.4 %.
    assert found[0].share > 0.9 and found[1].share < 0.02 and len(found[0].levels) == statistics.BINS


def test_every_combination_of_a_grid_has_its_own_mean() -> None:
    values = np.array([1.0, 5.0, 2.0, 6.0, 3.0, 7.0])
    found = statistics.points(results(values, range(6), tuning=["a", "b"] * 3, faults=[["x", "y"], []] * 3))
    assert [one.values for one in found] == [{"tuning": "a", "faults": "x, y"}, {"tuning": "b", "faults": "none"}]
    assert [one.figures["error_deg"].mean for one in found] == [2.0, 6.0]
    assert [one.figures["error_deg"].worst_index for one in found] == [4, 5]
    assert str(found[0].figures["error_deg"]).startswith("2 (1")


def test_the_interval_of_a_share_draws_pairs() -> None:
    """Both runs of a pair share their noise: the share is far better known than either mean."""
    mark = np.random.default_rng(4).uniform(1.0, 9.0, 200)
    low, high = intervals.share(0.6 * mark, mark)
    assert (low, high) == pytest.approx((60.0, 60.0))
    low, high = intervals.share(0.6 * np.roll(mark, 1), mark)
    # Unpaired, either mean of 200 is known to 3.3 %: together to 4.6 %, and 60 to 5 at 95 %.
    assert low < 58.0 and high > 62.0

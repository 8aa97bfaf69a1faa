"""Mean and spread of an error, each by itself, its spread compared with the filter's sigma, and the band with the
declared offset."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.proof import metrics, report
from plumb.proof.figures import Figure, paired, render


def test_mean_spread_and_their_share_of_sigma() -> None:
    steps, window = 4000, np.arange(4000) >= 1000
    error_deg = np.where(window, 0.3 + 0.2 * np.random.default_rng(1).standard_normal(steps), 50.0)
    truth_deg = np.linspace(-170.0, 190.0, steps)
    variance = np.full(steps, 16, np.int64)  # of 0.01 deg^2 each: 0.4 deg
    found = metrics.Consistency.of(truth_deg + error_deg, truth_deg, window, variance, 0.01)
    assert found.mean == pytest.approx(0.3, abs=0.02) and found.spread == pytest.approx(0.2, rel=0.05)
    assert found.per_sigma == pytest.approx(found.spread / 0.4)


def test_a_band_includes_the_declared_offset() -> None:
    """3 mg is 0.17 deg: with a filter that states a small sigma, the offset is nearly all of the band."""
    band = metrics.with_offset(np.array([0.0, 0.02, 10.0]), 0.003)
    assert band == pytest.approx([0.3438, 0.3444, 10.0059], abs=1e-4)
    plot = report.error_and_band(np.arange(3.0), np.zeros(3), band, 0.003)
    assert "3 mg or 0.17 deg" in plot.note and plot.lines[0].band is band


def test_a_row_has_the_interval_of_its_mean() -> None:
    values = np.random.default_rng(2).normal(1.0, 0.1, 400)
    row = Figure("error", "s", "t", "deg", "shown", 0.0, float(values.mean())).over(values)
    assert row.low is not None and row.high is not None
    assert row.low < 1.0 < row.high and row.high - row.low == pytest.approx(4 * 0.005, rel=0.2)
    assert f"{row.low:.3f} to {row.high:.3f}" in render([("quad", row)])
    assert Figure("error", "s", "t", "deg", "shown", 0.0, 1.0).over(values[:1]).low is None


def test_float64_of_the_first_runs_stands_for_all() -> None:
    ours = [1.0, 2.0, 3.0, 6.0]
    assert paired(ours, [1.1, 2.1]) == pytest.approx(3.1)

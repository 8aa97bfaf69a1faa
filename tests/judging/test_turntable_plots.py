"""The bands of the turntable's page are the filter's own variances, in the unit of the panel."""

from __future__ import annotations

import html

import numpy as np
import pytest

from plumb.boards.contract import Answer
from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.contract.scenario import fitted
from plumb.judging.turntable import figures as turntable_figures
from plumb.judging.turntable import plots
from plumb.proof import runs, xy_plot
from plumb.proof.report import Plot
from plumb.proof.runs import Run
from plumb.systems.turntable import scenarios as turntable


def panels(scenario: str, tuning: str, seconds: float = 14.0) -> tuple[Run, dict[str, Plot]]:
    """The panels of a run by title. The truth stands for the float64 reference, which they do not need."""
    drawn = turntable.scenario(scenario, 1000, seconds=seconds)
    params, inputs = quantise(fitted(drawn, turntable.TUNINGS[tuning])), runs.prescribed(drawn)
    words = native_core.run_control(params, inputs.raw, inputs.setpoint)
    run = Run(inputs, params, words, inputs.truth, Answer(words.digests(), words), None)
    return run, {plot.title: plot for plot in plots.plots(run, closed=False)}


def test_the_bands_begin_with_what_the_tuning_says() -> None:
    """All but that of the angular accelerometer, which the first step narrows."""
    _, found = panels("motion", "data", 2.0)
    fusion = turntable.TUNINGS["data"].fusion
    scale_percent = 100.0 * np.hypot(fusion.gyro_scale, fusion.angular_scale)
    begun = {
        "Gyro bias ± 2 sigma": fusion.start_gyro_dps,
        "Difference in scale ± 2 sigma": scale_percent,
        "Lag of the gyro ± 2 sigma": 1e3 * fusion.start_lag_s,
    }
    for title, sigma in begun.items():
        for line in found[title].lines:
            assert line.band is not None and line.band[0] == pytest.approx(2.0 * sigma, rel=1e-3)
    angular = found["Bias of the angular accelerometer ± 2 sigma"].lines[0].band
    assert angular is not None and 0.8 * 2.0 * fusion.start_angular_dps2 < angular[0] < 2.0 * fusion.start_angular_dps2


def test_of_white_noise_the_band_of_the_rate_holds_95_percent() -> None:
    run, found = panels("white", "known")
    expected, *errors = found["Error of the corrected rate"].lines
    assert expected.band is not None
    inside = [np.mean(np.abs(line.values) <= expected.band, where=run.inputs.scored) for line in errors]
    # 95 % are within two sigma; neighbours share a window, so that they are fewer than they seem: 2 %.
    assert 0.93 < np.mean(inside) < 0.97


def test_the_page_says_where_there_is_no_variance() -> None:
    _, found = panels("motion", "attitude", 2.0)
    assert all(line.band is None for line in found["Error of the corrected rate"].lines)
    for title in ("Error of the corrected rate", "Residual of the attitude"):
        assert "No band:" in found[title].note


def test_the_spread_over_runs_names_its_curves() -> None:
    plot = turntable_figures.spread_plot(range(1000, 1003))
    fused, undone, claim = plot.curves
    assert np.all(np.diff(fused.y) >= 0.0) and len(fused.y) == len(undone.y) == 3
    assert claim.y.tolist() == [turntable_figures.PATENT_SHARE[0]] * 2
    svg = xy_plot.plot_svg(plot)
    for curve in plot.curves:
        assert f"fill:{curve.colour}" in svg and html.escape(curve.label) in svg, "a legend"

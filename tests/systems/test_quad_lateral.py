"""The lateral acceleration behind the low-pass at the samples is that of the whole grid, filtered point by point."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.physics.sensors import OnePole
from plumb.systems.quad import lateral
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.drawn_run import on_grid
from plumb.systems.quad.lateral import GRID_S


@pytest.mark.parametrize("bandwidth_hz", [0.5, 5.0, 50.0, 350.0])
@pytest.mark.parametrize("period_us", [5_000, 20_000, 25_000])
@pytest.mark.parametrize("name", ["motion", "hold", "quiet"])
def test_samples_are_those_of_the_filtered_grid(name: str, period_us: int, bandwidth_hz: float) -> None:
    run = quad.scenario(name, 5, seconds=30.0, period_us=period_us, bandwidth_hz=bandwidth_hz)
    pole = OnePole.of(bandwidth_hz, GRID_S)
    found = run.lateral.low_passed(pole, period_us // 1000)
    assert found is not None
    wanted = on_grid(pole.run(run.lateral_g), run.time_s)
    assert np.max(np.abs(found - wanted)) < 1e-12
    assert np.any(found) == (name != "quiet")


@pytest.mark.parametrize(("seconds", "period_us"), [(30.0, 3_000), (30.0, 50_000), (30.01, 20_000)])
def test_other_periods_are_filtered_on_the_grid(seconds: float, period_us: int) -> None:
    """A fade that begins within a period, a sampling rate below that of the vibration, an end within a period."""
    run = quad.scenario("motion", 5, seconds=seconds, period_us=period_us)
    assert run.lateral.low_passed(OnePole.of(350.0, GRID_S), period_us // 1000) is None
    assert len(run.counts()) == run.steps


def test_a_run_is_long_enough_for_the_vibration() -> None:
    with pytest.raises(UsageError, match="longer run"):
        lateral.check(50)

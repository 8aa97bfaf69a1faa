"""The shipped tunings as parameter tables."""

from __future__ import annotations

import pytest

from plumb import systems
from plumb.systems.shipped_tunings import words_of


@pytest.mark.parametrize("tuning", [None, *systems.load("quadrotor").TUNINGS])
def test_a_tuning_of_a_vehicle_takes_its_calibration_back(tuning: str | None) -> None:
    """Its numbers replace those that a calibration found, and a pilot must not arm on them."""
    assert words_of("quadrotor", tuning)["calibrated"] == 0


def test_a_tuning_of_a_system_without_a_pilot_leaves_the_marker_alone() -> None:
    assert "calibrated" not in words_of("attitude", None)

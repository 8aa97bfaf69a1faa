"""A second frame under `quadrotor`: the iris, with gains worked out from its numbers."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.judging.quadrotor import figures, iris, loops
from plumb.judging.quadrotor.flown import fly
from plumb.physics.airframe import HUMMINGBIRD_X, IRIS_X
from plumb.systems.quadrotor import courses, frame_tuning, scenarios


def test_its_rotors_are_where_the_mixer_has_them() -> None:
    x, y, _ = np.array(IRIS_X.rotors_m).T
    assert np.sign(x).tolist() == [1.0, 1.0, -1.0, -1.0] and np.sign(y).tolist() == [-1.0, 1.0, 1.0, -1.0]
    for axis, row in zip(("roll", "pitch", "yaw"), IRIS_X.allocation()[1:], strict=True):
        assert np.sign(row).tolist() == loops.PATTERNS[axis].tolist(), axis


def test_the_gains_come_from_the_frame() -> None:
    """The numbers that the hummingbird's gains stand on are those of its frame, by the same rule."""
    x, y, z = frame_tuning.accelerations_radps2(HUMMINGBIRD_X)
    assert x == pytest.approx(scenarios.ROLL_ACCEL_RADPS2, rel=2e-3) and x == y
    assert z == pytest.approx(scenarios.YAW_ACCEL_RADPS2, rel=5e-3)


def test_it_flies() -> None:
    """What is asked of the hummingbird, on two seeds; with the gains of the hummingbird the loop would be another."""
    flown = fly("lean", (1000, 1001), iris.tuning(), frame=IRIS_X)
    begin_s = courses.ACTS_S
    held = np.abs(flown.around(flown.lean_deg, begin_s + 0.4, begin_s + courses.LEAN_S) - courses.LEAN_DEG)
    assert held.max() < 2.0
    found = loops.margins("pitch", iris.tuning(), frame=IRIS_X)
    assert found.phase_deg > figures.LEAST.phase_deg and found.delay_s > figures.LEAST.delay_s
    assert found.crossover_hz == pytest.approx(4.07, abs=0.1), "the hummingbird's"

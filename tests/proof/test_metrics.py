"""Metrics in closed form: windows, wrapping, convergence and recovery times."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plumb.proof import metrics
from plumb.systems import scoring

PERIOD_S = 0.02


@pytest.mark.parametrize(
    ("seconds", "from_s"), [(120.0, 10.0), (30.0, 10.0), (20.0, 10.0), (19.0, 9.5), (10.0, 5.0), (1.0, 0.5)]
)
def test_the_window_is_from_10_s_or_the_second_half(seconds: float, from_s: float) -> None:
    time_s = np.asarray(np.arange(round(seconds / PERIOD_S)) * PERIOD_S, np.float64)
    assert time_s[scoring.scored(time_s)][0] == pytest.approx(from_s, abs=PERIOD_S)
    assert scoring.scored(time_s)[-1]


def test_errors_wrap_and_are_scored_in_the_window_alone() -> None:
    truth = np.array([[0.0, 90.0], [179.0, 0.0], [-179.0, 0.0], [10.0, 0.0]])
    estimate = np.array([[77.0, 0.0], [-179.0, 3.0], [179.0, -4.0], [11.0, 0.0]])
    window = np.array([False, True, True, True])
    assert metrics.angle_rmse_deg(estimate, truth, window) == pytest.approx([math.sqrt(3.0), math.sqrt(25.0 / 3.0)])
    assert metrics.angle_max_deg(estimate, truth, window) == pytest.approx([2.0, 4.0])
    assert metrics.angle_rmse_deg(estimate[:, 0], truth[:, 0], window) == pytest.approx(math.sqrt(3.0))


def test_accelerometer_only_is_the_two_axis_angle() -> None:
    angle = np.radians([-170.0, -30.0, 0.0, 30.0, 170.0])
    assert metrics.accel_only_deg(1.2 * np.sin(angle), 1.2 * np.cos(angle)) == pytest.approx(np.degrees(angle))


def test_gyro_only_takes_off_the_bias_of_the_rest_and_adds_up_the_rest() -> None:
    rate_dps = np.full(500, 2.0)
    rate_dps[200:300] += 30.0
    tilt_deg = metrics.gyro_only_deg(rate_dps, PERIOD_S, np.array(5.0))
    assert tilt_deg[:201] == pytest.approx(5.0) and tilt_deg[300:] == pytest.approx(65.0)


@pytest.mark.parametrize(
    ("bias_error_dps", "time_s", "angle"),
    [
        ([5.0, 3.0, 0.9, 0.5, 0.1, 0.0], 0.06, 3.0),
        ([5.0, 0.5, -1.0, 0.5, -0.2, 0.0], 0.08, 2.0),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.02, 30.0),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 1.5], math.inf, math.inf),
    ],
)
def test_convergence_is_when_the_bias_error_stays_small(
    bias_error_dps: list[float], time_s: float, angle: float
) -> None:
    tilt_error_deg = np.array([30.0, 10.0, -3.0, 2.0, -1.0, 0.5])
    found = metrics.convergence(np.array(bias_error_dps), tilt_error_deg, PERIOD_S)
    assert (found.time_s, found.angle_max_deg) == pytest.approx((time_s, angle))


def test_hold_counts_from_the_release_until_it_stays_inside() -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    tilt_deg = np.where(time_s < 4.0, 20.0, 0.0)
    tilt_deg[45], tilt_deg[55], tilt_deg[70] = -3.0, 1.9, 1.0
    found = metrics.hold(time_s, tilt_deg, np.zeros_like(time_s), 3.0)
    assert found.recovery_s == pytest.approx(1.6) and found.max_deg == pytest.approx(1.9)
    assert found.rms_deg == pytest.approx(math.sqrt((1.9**2 + 1.0) / 50.0))
    tilt_deg[-1] = 5.0
    late = metrics.hold(time_s, tilt_deg, np.zeros_like(time_s), 3.0)
    assert late.recovery_s == pytest.approx(1.6) and late.max_deg == 5.0, "a later excursion counts as what it is"
    tilt_deg[::9] = 5.0
    assert metrics.hold(time_s, tilt_deg, np.zeros_like(time_s), 3.0).recovery_s == math.inf
    assert math.isnan(metrics.hold(time_s, tilt_deg, np.zeros_like(time_s), 9.0).rms_deg), (
        "ends before it can be judged"
    )
    never = metrics.hold(time_s, np.full_like(time_s, 1.5), np.zeros_like(time_s), 3.0)
    assert never.recovery_s == pytest.approx(0.0) and never.rms_deg == pytest.approx(1.5)

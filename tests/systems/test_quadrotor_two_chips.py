"""`quadrotor` with an ADXL345 and an ITG-3205: a rest before the take-off determines the bias of so noisy a gyro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.judging.quadrotor import figures
from plumb.judging.quadrotor.flown import fly
from plumb.systems.quadrotor import scenarios

WORST = (1163, 1217)
"""The two worst of seeds 1000 to 1399 where every second before the take-off counts as motion."""


def test_a_rest_before_the_take_off_is_seen_through_the_noise() -> None:
    """At 2.5 ms an ITG-3205 has 0.42 deg/s of noise a sample, and a second has 400 samples of three axes."""
    tuning = scenarios.TUNINGS[scenarios.TWO_CHIPS_NAME]
    as_quiet_gyros = replace(tuning.attitude, rest=scenarios.ESTIMATOR.rest)
    rms = []
    for one in (tuning, replace(tuning, attitude=as_quiet_gyros)):
        flown = fly("two-chips", WORST, one)
        error_deg = flown.error_deg[flown.between(figures.SCORED_FROM_S, np.inf)]
        rms.append(np.sqrt(np.mean(error_deg**2, axis=0)))
    asked = figures.RMS["two-chips"][0][1]
    assert rms[0].max() < asked < rms[1].min(), "what is asked of the worst seed, with and without it"

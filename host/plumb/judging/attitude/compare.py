"""The vertical of `attitude`, for `plumb compare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.analyses.comparison.samples import Estimate, Samples
from plumb.boards import native_core
from plumb.systems.attitude import scenarios
from plumb.tuning.quantise import ControlParams, quantise

TUNING_NAME = scenarios.DEFAULT_TUNING


def params(samples: Samples) -> ControlParams:
    """The tuning for these sensors and this period."""
    sensor = samples.sensor
    tuning = scenarios.TUNINGS[TUNING_NAME]
    return quantise(replace(tuning, period_us=samples.period_us, gyro=sensor.gyro, accel=sensor.accel))


def estimate(samples: Samples) -> Estimate:
    """The vertical and the filter's own standard deviation after each sample; missing samples are marked as such."""
    words = native_core.run_control(params(samples), samples.marked, np.zeros(len(samples.counts), np.int32))
    up = np.stack([words[f"up_q30_{axis}"] for axis in range(3)], 1) / 2.0**30
    return Estimate(up, np.degrees(np.sqrt(words["tilt_variance_rad2_q32"] / 2.0**32)))

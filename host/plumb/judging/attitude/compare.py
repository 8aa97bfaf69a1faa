"""The vertical of `attitude`, for `plumb compare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.samples import Samples
from plumb.boards import native_core
from plumb.systems.attitude import scenarios
from plumb.tuning.quantise import ControlParams, quantise

TUNING_NAME = scenarios.DEFAULT_TUNING


def params(samples: Samples) -> ControlParams:
    """The tuning for these sensors and this period."""
    sensor = samples.sensor
    tuning = scenarios.TUNINGS[TUNING_NAME]
    return quantise(replace(tuning, period_us=samples.period_us, gyro=sensor.gyro, accel=sensor.accel))


def verticals(samples: Samples) -> npt.NDArray[np.float64]:
    """The vertical in sensor coordinates after each sample, (N, 3)."""
    words = native_core.run_control(params(samples), samples.counts, np.zeros(len(samples.counts), np.int32))
    return np.stack([words[f"up_q30_{axis}"] for axis in range(3)], 1) / 2.0**30

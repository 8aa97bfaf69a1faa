"""The vertical of `attitude`, for `plumb compare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.analyses.comparison.samples import Estimate, Samples
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof.runs import RunInputs
from plumb.spec.tuning import AnyTuning
from plumb.systems.attitude import scenarios
from plumb.systems.attitude.tuning import AttitudeTuning

TUNING_NAME = scenarios.DEFAULT_TUNING


def params(samples: Samples, tuning: AnyTuning | None = None) -> ControlParams:
    """The tuning for these sensors and this period. None: the shipped one."""
    sensor = samples.sensor
    given = tuning or scenarios.TUNINGS[TUNING_NAME]
    assert isinstance(given, AttitudeTuning)
    return quantise(replace(given, period_us=samples.period_us, gyro=sensor.gyro, accel=sensor.accel))


def inputs(samples: Samples) -> RunInputs:
    """The samples as inputs of a run; missing ones are marked as such."""
    steps = len(samples.counts)
    truth = {f"up_{axis}": column for axis, column in zip("xyz", samples.up.T, strict=True)}
    truth |= {f"bias_{axis}_dps": np.full(steps, np.nan) for axis in "xyz"}
    return RunInputs(samples.time_s, truth, samples.marked, np.zeros(steps, np.int32), samples.scored)


def estimate(samples: Samples) -> Estimate:
    """The vertical and the filter's own standard deviation after each sample; missing samples are marked as such."""
    words = native_core.run_control(params(samples), samples.marked, np.zeros(len(samples.counts), np.int32))
    up = np.stack([words[f"up_q30_{axis}"] for axis in range(3)], 1) / 2.0**30
    return Estimate(up, np.degrees(np.sqrt(words["tilt_variance_rad2_q32"] / 2.0**32)))

"""The vertical that pitch and roll of `phone` make, for `plumb compare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.analyses.comparison.samples import Estimate, Samples
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof.runs import RunInputs
from plumb.spec.tuning import AnyTuning
from plumb.systems.phone import scenarios as phone
from plumb.systems.phone.tuning import PhoneTuning

TUNING_NAME = phone.DEFAULT_TUNING
TURN_DEG = 360.0 / 2.0**32
"""Degrees per unit of a binary angle."""


def params(samples: Samples, tuning: AnyTuning | None = None) -> ControlParams:
    """The tuning for these sensors and this period. None: the shipped one."""
    sensor = samples.sensor
    given = tuning or phone.TUNINGS[TUNING_NAME]
    assert isinstance(given, PhoneTuning)
    return quantise(replace(given, period_us=samples.period_us, gyro=sensor.gyro, accel=sensor.accel))


def inputs(samples: Samples) -> RunInputs:
    """The samples as inputs of a run."""
    truth = dict(zip(("pitch_deg", "roll_deg"), phone.pitch_roll_deg(samples.up.T), strict=True))
    setpoint = np.zeros(len(samples.counts), np.int32)
    return RunInputs(samples.time_s, truth, samples.counts, setpoint, samples.scored)


def estimate(samples: Samples) -> Estimate:
    """The vertical after each sample; the two filters know no missing one, and state no tilt of their own."""
    words = native_core.run_control(params(samples), samples.counts, np.zeros(len(samples.counts), np.int32))
    pitch_deg, roll_deg = (words[f"{axis}_turn_q32"] * TURN_DEG for axis in ("pitch", "roll"))
    return Estimate(np.asarray(phone.up(pitch_deg, roll_deg).T, np.float64))

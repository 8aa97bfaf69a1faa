"""The vertical that pitch and roll of `phone` make, for `plumb compare`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.analyses.comparison.samples import Estimate, Samples
from plumb.boards import native_core
from plumb.systems.phone import scenarios as phone
from plumb.tuning.quantise import ControlParams, quantise

TUNING_NAME = phone.DEFAULT_TUNING
TURN_DEG = 360.0 / 2.0**32
"""Degrees per unit of a binary angle."""


def params(samples: Samples) -> ControlParams:
    """The tuning for these sensors and this period."""
    sensor = samples.sensor
    tuning = phone.TUNINGS[TUNING_NAME]
    return quantise(replace(tuning, period_us=samples.period_us, gyro=sensor.gyro, accel=sensor.accel))


def estimate(samples: Samples) -> Estimate:
    """The vertical after each sample; the two filters know no missing one, and state no tilt of their own."""
    words = native_core.run_control(params(samples), samples.counts, np.zeros(len(samples.counts), np.int32))
    pitch_deg, roll_deg = (words[f"{axis}_turn_q32"] * TURN_DEG for axis in ("pitch", "roll"))
    return Estimate(np.asarray(phone.up(pitch_deg, roll_deg).T, np.float64))

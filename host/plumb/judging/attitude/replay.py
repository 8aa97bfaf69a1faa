"""All six axes of a recording of real sensors as inputs of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.proof.runs import RunInputs
from plumb.proof.scenario_run import OWN
from plumb.readers import recording
from plumb.readers.replay import ReplayRequest
from plumb.systems.attitude import scenarios
from plumb.systems.attitude.quantise import PERIODS_US
from plumb.systems.attitude.tuning import AttitudeTuning


def inputs_of(request: ReplayRequest) -> tuple[RunInputs, ControlParams, dict[str, object]]:
    """Inputs, parameters, and the first entries of the summary of `plumb replay`. The counts are those of the default
    sensor; samples beyond its range clip as they would there."""
    recorded = request.recording()
    period_us = round(recorded.step_s * 1e6) if request.period_us is None else request.period_us
    low, high = PERIODS_US
    if not low <= period_us <= high:
        raise UsageError(f"a period of {period_us} us is outside {low} to {high} us; resample with --period-us")
    if recorded.time_s[-1] > recording.MOST_STEPS * period_us * 1e-6:
        raise UsageError(f"{request.file.name} has more than {recording.MOST_STEPS} steps of {period_us} us: cut it")
    given = request.tuning or scenarios.TUNINGS[scenarios.DEFAULT_TUNING]
    assert isinstance(given, AttitudeTuning)
    tuning = replace(given, period_us=period_us)
    values = recording.steady(recorded.time_s, np.hstack([recorded.gyr_dps, recorded.acc_g]), period_us)
    if request.seconds is not None:
        values = values[: recording.steps_in(request.seconds, period_us, len(values))]
    raw = np.empty((len(values), 6), np.int16)
    for columns, channel in ((slice(0, 3), tuning.gyro), (slice(3, 6), tuning.accel)):
        counts = np.rint(values[:, columns] / channel.unit_per_count)
        raw[:, columns] = np.clip(counts, channel.min_counts, channel.max_counts)

    time_s = np.arange(len(raw), dtype=np.float64) * (period_us * 1e-6)
    up, scored = np.full((3, len(raw)), np.nan), np.zeros(len(raw), bool)
    if recorded.ref_quat is not None:
        vertical = recording.vertical(recorded.ref_quat)
        up = np.stack([np.interp(time_s, recorded.time_s, column) for column in vertical.T])
        nearest = np.rint(np.interp(time_s, recorded.time_s, np.arange(len(recorded.time_s)))).astype(int)
        scored = recorded.movement[nearest] & np.isfinite(up).all(axis=0)
    truth = {f"up_{axis}": row for axis, row in zip("xyz", up, strict=True)}
    truth |= {f"bias_{axis}_dps": np.full(len(raw), np.nan) for axis in "xyz"}
    name = OWN if request.tuning else scenarios.DEFAULT_TUNING
    heading: dict[str, object] = {"scenario": request.file.name, "tuning": name}
    return RunInputs(time_s, truth, raw, np.zeros(len(raw), np.int32), scored), quantise(tuning), heading

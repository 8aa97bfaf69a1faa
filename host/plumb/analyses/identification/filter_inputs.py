"""Inputs of a system's one-axis filter from a recording: measured tilt, rate, and R of every step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb.analyses.identification import chosen_settings, rest
from plumb.analyses.identification.innovations import Measured, Variances
from plumb.contract.parameters import dequantise
from plumb.contract.run_reference import run_control
from plumb.errors import UsageError
from plumb.kernels.reference.kernels import driving_rate
from plumb.readers import recording, replay
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.tuning import AxisTuning

LEAST_STEPS = 1000
UNLIMITED_DEG2 = 1e12


@dataclass(frozen=True)
class FilterInputs:
    """A recording for the filter of a tuning. truth_deg: of the tilt, NaN where it is not known; scored: the samples at
    which it counts."""

    title: str
    tuning_name: str
    tuning: AxisTuning
    measured: Measured
    truth_deg: FloatArray
    scored: BoolArray

    @property
    def start(self) -> Variances:
        """The tuning's own variances."""
        kalman = self.tuning.kalman
        return Variances(kalman.q_angle_deg2_per_s, kalman.q_bias_dps2_per_s, self.tuning.trust.r_deg2)


def inputs_of(
    path: Path, system: str, tuning_name: str | None, axis: str, period_us: int | None, seconds: float | None
) -> FilterInputs:
    """Read a recording: of a three-axis sensor, as `plumb replay` does, or a log of `plumb record`. tuning_name: of
    a shipped tuning; None: the one that `plumb replay` uses, or that the board had.

    Raises UsageError for what cannot be read, a system without such a filter, and a recording that is too short.
    """
    if rest.is_log(path):
        params, raw = rest.board_recording(path)
        if system and system != params.system:
            raise UsageError(f"{path} was recorded on a board that was {params.system}, not {system}")
        if period_us is not None:
            raise UsageError("--period-us is for recordings of a three-axis sensor: a board's counts have its period")
        name, truth_deg, scored = "as recorded", np.full(len(raw), np.nan), np.zeros(len(raw), np.bool_)
    else:
        prepared = replay.prepare(system, replay.ReplayRequest(path, axis, period_us, None))
        params, raw = prepared.params, prepared.inputs.raw.astype(np.float64)
        name = str(prepared.heading.get("tuning", "of replay"))
        truth_deg = prepared.inputs.truth.get("tilt_deg", np.full(len(raw), np.nan))
        scored = prepared.inputs.scored
    own = dequantise(params)
    tuning = own if tuning_name is None else _chosen(params.system, tuning_name, own)
    if not isinstance(tuning, AxisTuning):
        raise UsageError(f"{params.system} has no one-axis filter of tilt and bias, which is what is tuned here")
    steps = len(raw)
    if seconds is not None:
        steps = recording.steps_in(seconds, tuning.period_us, len(raw))
    if steps < LEAST_STEPS:
        raise UsageError(f"{path.name}: {steps} steps are too few to determine Q and R: give {LEAST_STEPS} or more")
    measured = _measured(tuning, raw[:steps])
    title = f"{path.name}" + ("" if rest.is_log(path) else f" about {axis}")
    return FilterInputs(title, tuning_name or name, tuning, measured, truth_deg[:steps], scored[:steps])


def _chosen(system: str, name: str, own: object) -> object:
    """A shipped tuning with the calibration and the period of the recording."""
    chosen = chosen_settings.named_tuning(system, name)[1]
    if not isinstance(chosen, AxisTuning) or not isinstance(own, AxisTuning):
        return chosen
    return replace(chosen, calibration=own.calibration, period_us=own.period_us, exact_period_s=own.exact_period_s)


def _measured(tuning: AxisTuning, raw: npt.NDArray[np.float64]) -> Measured:
    """Inputs of the filter: run the system's reference model up to it."""
    r_base = tuning.trust.r_deg2
    open_ended = replace(tuning, trust=replace(tuning.trust, r_max_deg2=UNLIMITED_DEG2))
    found = run_control(open_ended, raw)
    rate_dps = found["rate_dps"]
    rate_dps = np.asarray(driving_rate(tuning.kalman.rate, rate_dps, np.concatenate([rate_dps[:1], rate_dps[:-1]])))
    growth_deg2 = np.maximum(found["r_deg2"] - r_base, 0.0)
    r_max_deg2 = tuning.trust.r_max_deg2 if tuning.trust.gain_deg2 else UNLIMITED_DEG2
    return Measured(tuning.period_s, found["tilt_measured_deg"], rate_dps, growth_deg2, r_max_deg2)

"""`plumb.Estimator`: the integer estimator of a system on arrays of a body's sensors, computed by the C core."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from plumb.api import arguments
from plumb.api.signals import ArraySignals, StepSignals
from plumb.audit import warned
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.proof.scenario_run import tuning_of
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.tuning.channels import NO_SAMPLE, counts_of, ideal_channel, with_channels

if TYPE_CHECKING:
    from plumb.spec.tuning import AnyTuning, Channel


G_MPS2 = 9.80665
_INPUTS = {"gyr": "gyr_radps", "acc": "acc_mps2", "ang": "ang_radps2"}
"""Sensor of a channel's axis -> the argument that has it."""
_TO_CALIBRATED = {"gyr": 180.0 / np.pi, "acc": 1.0 / G_MPS2, "ang": 180.0 / np.pi}
"""Sensor -> what a calibration counts in (deg/s, g, deg/s^2) per unit of SI."""
_PERIODS_S = (0.0005, 0.1)


class Estimate(ArraySignals):
    """Result of an estimator for N samples: a mapping of signal -> array (N,) in units of SI.

    The keys are the words of the system's record with the unit at the end: `tilt_rad`, `bias_radps`,
    `rate_corrected_radps`, `accel_y_mps2`, ... `list(estimate)` names them all, and docs/reference/records.md says what
    each is. The names in deg and g work, too, and every name is an attribute as well (plumb.api.signals).

    Attributes:
        period_s: Time between two samples, s.
        words: The integer words of every step, (N,) int64 each, by the names of the record.
        raw: Raw counts that the samples became, (N, 6) int16.
        saturated: Samples with a count outside its channel's range, (N,) bool.
    """

    SI = True
    words: Words

    def __init__(self, words: Words, raw: npt.NDArray[np.int16], period_s: float) -> None:
        self.words, self.raw, self.period_s = words, raw, period_s
        declared = declarations.system(words.system)
        mask = sum(1 << bit for bit, flag in enumerate(declared.flags) if flag.saturated)
        self.saturated: npt.NDArray[np.bool_] = (words["flags"] & mask) != 0

    def __repr__(self) -> str:
        return f"<Estimate of {self.words.system}: {len(self.raw)} samples of {self.period_s:g} s>"

    @property
    def system(self) -> str:
        """Name of the system."""
        return self.words.system

    def _of(self) -> str:
        return self.words.system

    def _word(self, name: str) -> npt.NDArray[np.int64]:
        return self.words[name]

    @property
    def time_s(self) -> FloatArray:
        """Time of the samples, (N,) s, from 0."""
        return np.arange(len(self.raw), dtype=np.float64) * self.period_s

    @property
    def digests(self) -> npt.NDArray[np.uint32]:
        """CRC-32 of every step's words, (N,): equal digests are equal bits."""
        return self.words.digests()


@dataclass(frozen=True)
class StepEstimate(StepSignals):
    """Result of `Estimator.step` for one sample: signal -> value in units of SI, as `Estimate` has arrays.

    Attributes:
        words: The integer words of the step, by the names of the record.
        digest: CRC-32 of the words.
    """

    SI: ClassVar[bool] = True
    system: str
    words: dict[str, int]
    digest: int

    def _of(self) -> str:
        return self.system

    def _word(self, name: str) -> npt.NDArray[np.int64]:
        return np.asarray(self.words[name], np.int64)


class Estimator:
    """The estimator of a system, in integers, on samples of a body's sensors in units of SI.

    The samples are quantised to counts of the tuning's sensor, or of an ideal 16-bit sensor of the given full scale,
    and the C core computes every step: a board of this system with the same parameters gives the same bits.

    Axes are the body's: at rest and level the accelerometer reads (0, 0, +9.80665) m/s^2 (specific force, z up), and a
    positive rate about an axis turns right-handed about it. What a system uses of them, its declaration says
    (`Estimator.axes`):

    | system | uses | estimates |
    |---|---|---|
    | `quad` | `gyr_x`, `acc_y`, `acc_z` | tilt about x (roll) |
    | `balancer` | `gyr_y`, `acc_x`, `acc_z` | tilt about y (pitch, forward is positive) |
    | `phone` | all of `gyr` and `acc` | pitch and roll |
    | `turntable` | all of `gyr` and `ang` (angular acceleration) | attitude from the start |
    | `attitude` | all of `gyr` and `acc` | attitude, its vertical from `acc`, its heading from `gyr` |

    Args:
        system: Name of a system: `quad`, `balancer`, `phone`, `turntable`, `attitude`.
        tuning: Name of one of the system's tunings, a tuning object, or None for the system's default.
        period_s: Time between two samples, 0.0005 to 0.1 s, taken to the nearest microsecond; None: the tuning's.
        gyr_range_dps: Full scale of an ideal gyro, deg/s, at most 2520; None: the sensor of the tuning.
        acc_range_g: Full scale of an ideal accelerometer, g, at most 28; None: the sensor of the tuning.
        ang_range_dps2: Full scale of an ideal angular accelerometer, deg/s^2, at most 2520; None: that of the tuning.

    Raises:
        UsageError: A name that does not exist, a period or a full scale out of range, or a full scale of a sensor that
            the system does not have.
    """

    def __init__(
        self,
        system: str,
        tuning: str | AnyTuning | None = None,
        *,
        period_s: float | None = None,
        gyr_range_dps: float | None = None,
        acc_range_g: float | None = None,
        ang_range_dps2: float | None = None,
    ) -> None:
        if not isinstance(system, str):
            raise UsageError(f"system = {arguments.shown(system)}: give the name of a system")
        ranges = {"gyr_range_dps": gyr_range_dps, "acc_range_g": acc_range_g, "ang_range_dps2": ang_range_dps2}
        arguments.require_number(period_s=period_s, **ranges)
        self.system = system
        self._declared = declarations.system(system)
        if not any(channel.axis for channel in self._declared.channels):
            raise UsageError(f"{system} does not say which axes of a body's sensors its channels are")
        _, chosen = tuning_of(system, tuning)
        chosen = at_period(chosen, period_s)
        full_scales = {"gyr": gyr_range_dps, "acc": acc_range_g, "ang": ang_range_dps2}
        self.tuning = with_channels(chosen, self._ideal_channels(full_scales))
        self.params: ControlParams = quantise(self.tuning)
        native_core.require_valid(self.params)
        self._controller: native_core.Controller | None = None

    def _ideal_channels(self, ranges: Mapping[str, float | None]) -> dict[str, Channel]:
        names = {"gyr": "gyr_range_dps", "acc": "acc_range_g", "ang": "ang_range_dps2"}
        found: dict[str, Channel] = {}
        for sensor, full_scale in ranges.items():
            if full_scale is None:
                continue
            if not 0.0 < full_scale < np.inf:
                raise UsageError(f"{names[sensor]} = {full_scale:g}: a full scale is more than 0")
            groups = {channel.calibration for channel in self._declared.channels if sensor in channel.axis}
            if not groups:
                raise UsageError(f"{names[sensor]}: {self.system} uses {', '.join(self.axes.values())}")
            found |= dict.fromkeys(groups, ideal_channel(full_scale))
        return found

    @property
    def axes(self) -> dict[str, str]:
        """Raw channel of the system -> the component of the body's sensors that it is, as `gyr_x` or `-acc_x`."""
        return {channel.name: channel.axis for channel in self._declared.channels if channel.axis}

    @property
    def period_s(self) -> float:
        """Time between two samples, s."""
        return self.tuning.period_us * 1e-6

    def counts(
        self,
        gyr_radps: npt.ArrayLike,
        acc_mps2: npt.ArrayLike | None = None,
        *,
        ang_radps2: npt.ArrayLike | None = None,
        channels: Mapping[str, npt.ArrayLike] | None = None,
    ) -> npt.NDArray[np.int16]:
        """Raw counts of N samples, (N, 6) int16, as a board with these sensors would have them.

        Args and errors are those of `run`.
        """
        arguments.require_mapping(channels=channels)
        given = self._inputs({"gyr": gyr_radps, "acc": acc_mps2, "ang": ang_radps2})
        steps = len(next(iter(given.values())))
        raw = np.zeros((steps, self._declared.counts), np.int16)
        others = dict(channels or {})
        for place, channel in enumerate(self._declared.channels):
            if channel.axis:
                sensor, letter = channel.axis.removeprefix("-").split("_")
                values = given[sensor][:, "xyz".index(letter)] * _TO_CALIBRATED[sensor]
                missing = np.isnan(values)
                signed = -values if channel.axis.startswith("-") else values
                raw[:, place] = counts_of(self.params, channel, np.where(missing, 0.0, signed))
                raw[missing, place] = NO_SAMPLE
            elif channel.name in others:
                raw[:, place] = self._other(channel.name, others.pop(channel.name), steps)
        if others:
            known = [channel.name for channel in self._declared.channels if not channel.axis]
            raise UsageError(
                f"{self.system} takes no channel {next(iter(others))}; it takes {', '.join(known) or 'none'}"
            )
        return raw

    def run(
        self,
        gyr_radps: npt.ArrayLike,
        acc_mps2: npt.ArrayLike | None = None,
        *,
        ang_radps2: npt.ArrayLike | None = None,
        channels: Mapping[str, npt.ArrayLike] | None = None,
    ) -> Estimate:
        """Estimate N samples from the start of the filter.

        Args:
            gyr_radps: Angular rate, (N, 3) rad/s.
            acc_mps2: Specific force, (N, 3) m/s^2; for systems that use `acc`.
            ang_radps2: Angular acceleration, (N, 3) rad/s^2; for systems that use `ang`. A row of NaN, of this or of
                `gyr_radps`, is a step without a sample of that sensor, in systems of sensors of different rates; in
                `attitude` a row of NaN in both arrays is a step without a sample.
            channels: Counts of raw channels that no axis is, (N,) integers by name, as `edges` of `balancer`; 0 where
                left out, wheels that stand still.

        Returns:
            The signals of every step, (N,) each.

        Warns:
            RecordingWarning: Units or axes of `gyr_radps` and `acc_mps2` are surely wrong, in 2 s or more of samples of
                systems that use both: seen in the 2000 samples with most turning. Each is said once of the same arrays,
                and of their parts.

        Raises:
            UsageError: A shape other than (N, 3), a number that is not finite, or a sensor that is missing or that the
                system does not use.
        """
        raw = self.counts(gyr_radps, acc_mps2, ang_radps2=ang_radps2, channels=channels)
        if acc_mps2 is not None:
            given = self._inputs({"gyr": gyr_radps, "acc": acc_mps2, "ang": ang_radps2})
            warned.warn_of_arrays(given["gyr"], given["acc"], self.period_s, 2, (gyr_radps, acc_mps2))
        words = native_core.run_control(self.params, raw, np.zeros(len(raw), np.int32))
        return Estimate(words, raw, self.period_s)

    def step(
        self,
        gyr_radps: npt.ArrayLike,
        acc_mps2: npt.ArrayLike | None = None,
        *,
        ang_radps2: npt.ArrayLike | None = None,
        channels: Mapping[str, int] | None = None,
    ) -> StepEstimate:
        """Estimate the next sample of a stream; the same samples through `run` give the same bits.

        Args:
            gyr_radps: Angular rate, (3,) rad/s.
            acc_mps2: Specific force, (3,) m/s^2; for systems that use `acc`.
            ang_radps2: Angular acceleration, (3,) rad/s^2; for systems that use `ang`.
            channels: Counts of raw channels that no axis is, by name.

        Returns:
            The signals of this step.

        Raises:
            UsageError: As `run`, for shapes other than (3,).
        """
        arguments.require_mapping(channels=channels)
        rows = [None if one is None else _row(one) for one in (gyr_radps, acc_mps2, ang_radps2)]
        if rows[0] is None:
            raise UsageError("gyr_radps is missing: give (3,)")
        others = {name: [value] for name, value in (channels or {}).items()}
        raw = self.counts(rows[0], rows[1], ang_radps2=rows[2], channels=others)
        if self._controller is None:
            self._controller = native_core.Controller(self.params)
        words = self._controller.step(raw[0].tolist(), 0)
        return StepEstimate(self.system, words, self._controller.digest())

    def reset(self) -> None:
        """Go back to the start of the filter: the next `step` is the first."""
        self._controller = None

    def _inputs(self, given: Mapping[str, npt.ArrayLike | None]) -> dict[str, FloatArray]:
        """The arrays of the sensors that the system uses, checked."""
        used = {channel.axis.removeprefix("-")[:3] for channel in self._declared.channels if channel.axis}
        arguments = [_INPUTS[sensor] for sensor in given if sensor in used]
        for sensor, values in given.items():
            if (values is None) is (sensor in used):
                state = "is missing" if values is None else "is of no use"
                raise UsageError(f"{_INPUTS[sensor]} {state}: {self.system} estimates from {' and '.join(arguments)}")
        arrays = {
            sensor: self._array(_INPUTS[sensor], values) for sensor, values in given.items() if values is not None
        }
        lengths = {_INPUTS[sensor]: len(values) for sensor, values in arrays.items()}
        if len(set(lengths.values())) > 1:
            text = " and ".join(f"{name} {length}" for name, length in lengths.items())
            raise UsageError(f"the arrays have different numbers of samples: {text}")
        if {"gyr", "acc"} <= set(arrays):
            alone = np.isnan(arrays["acc"]).all(axis=1) & ~np.isnan(arrays["gyr"]).all(axis=1)
            if alone.any():
                raise UsageError(
                    f"acc_mps2 of sample {int(np.argmax(alone))} is NaN and gyr_radps is not: a step without a sample"
                    " has NaN in both"
                )
        return arrays

    def _array(self, name: str, values: npt.ArrayLike) -> FloatArray:
        array = _real(name, values, "(N, 3)")
        if array.ndim != 2 or array.shape[1] != 3 or not len(array):
            raise UsageError(f"{name} has the shape {array.shape}: give (N, 3), N at least 1")
        arguments.require_steps(name, len(array))
        bad = ~np.isfinite(array).all(axis=1)
        if self._declared.missing_samples == "marked":
            bad &= ~np.isnan(array).all(axis=1)
        if bad.any():
            raise UsageError(
                f"{name} of sample {int(np.argmax(bad))} is not finite: leave it out, or repair the recording"
            )
        return array

    def _other(self, name: str, values: npt.ArrayLike, steps: int) -> npt.NDArray[np.int16]:
        counts = np.asarray(values)
        if counts.shape != (steps,) or counts.dtype.kind not in "iu":
            raise UsageError(f"channel {name} is {counts.dtype} of shape {counts.shape}: give ({steps},) integers")
        if counts.min() < -32768 or counts.max() > 32767:
            raise UsageError(f"channel {name} reaches {counts.min()} to {counts.max()}: counts have 16 bits")
        return counts.astype(np.int16)


def at_period(tuning: AnyTuning, period_s: float | None) -> AnyTuning:
    """The tuning for another period, to the nearest microsecond; None: as it is. Raises UsageError out of range."""
    if period_s is None:
        return tuning
    if not _PERIODS_S[0] <= period_s <= _PERIODS_S[1]:
        raise UsageError(f"period_s = {period_s:g}: a period is from {_PERIODS_S[0]:g} to {_PERIODS_S[1]:g} s")
    return replace(tuning, period_us=round(period_s * 1e6), exact_period_s=None)


def _real(name: str, values: npt.ArrayLike, shape: str) -> FloatArray:
    """The array in float64; raises UsageError for what holds anything but real numbers."""
    try:
        given = np.asarray(values)
        if given.dtype.kind in "fiu":
            return np.asarray(given, np.float64)
    except (TypeError, ValueError):
        pass
    raise UsageError(f"{name} is no array of numbers: give {shape}")


def _row(values: npt.ArrayLike) -> FloatArray:
    array = _real("a sample", values, "(3,)")
    if array.shape != (3,):
        raise UsageError(f"a sample has the shape {array.shape}: give (3,)")
    return array[np.newaxis]

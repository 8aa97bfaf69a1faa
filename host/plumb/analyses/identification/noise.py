"""From a rest to the noise of each sensor, and to Q and R of a system's filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plumb.analyses.identification import chosen_settings
from plumb.analyses.identification.allan import AllanDeviation, allan_deviation
from plumb.analyses.identification.noise_fit import Estimate, Misfit, NoiseModel, Spectrum, fit, misfit
from plumb.analyses.identification.rest import Channel, Rest
from plumb.errors import UsageError
from plumb.spec.tuning import AnyTuning, AxisTuning

FEW_LEVELS = 4
"""With fewer different values than this, a signal is mostly the rounding of its counts."""
FILTER_PARTS = ("white", "walk")
"""The noise of the filter's model: white noise of the rate, and a bias that walks."""


@dataclass(frozen=True)
class ChannelNoise:
    """One signal. model: white, flicker and walk together; as_filter: white and walk alone, the model of the filter."""

    channel: Channel
    rms: float
    levels: int
    model: NoiseModel
    as_filter: NoiseModel
    allan: AllanDeviation
    misfit: Misfit | None

    def warnings(self) -> list[str]:
        found = []
        if self.levels < FEW_LEVELS:
            found.append(
                f"{self.channel.name}: only {self.levels} different values: its noise is below the step of its counts, "
                "and the figures are those of the rounding"
            )
        if self.misfit is not None:
            found.append(
                f"{self.channel.name}: from {self.misfit.low_hz:.3g} to {self.misfit.high_hz:.3g} Hz the recording has "
                f"{self.misfit.ratio:.2g} times the power of the fitted noise: vibration, a filter or a motion is in "
                "it; --highest-hz leaves out the frequencies above"
            )
        return found


@dataclass(frozen=True)
class FilterNoise:
    """Q and R for a tuning. values: settings by whole name; notes: how each comes about; refusal: why the board cannot
    hold them, "" if it can."""

    system: str
    tuning_name: str
    tuning: AnyTuning
    values: dict[str, float]
    notes: dict[str, str]
    refusal: str


def measure(rest: Rest, highest_hz: float | None = None) -> list[ChannelNoise]:
    """The noise of every signal of a rest; raises UsageError for a signal without noise."""
    if highest_hz is not None and not 1.0 / (len(rest.channels[0].values) * rest.period_s) < highest_hz:
        raise UsageError(f"--highest-hz {highest_hz:g}: the recording is too short for it")
    return [_measured(channel, rest.period_s, highest_hz) for channel in rest.channels]


def _measured(channel: Channel, period_s: float, highest_hz: float | None) -> ChannelNoise:
    try:
        spectrum = Spectrum(channel.values, period_s, highest_hz)
    except UsageError as error:
        raise UsageError(f"{channel.name}: {error}") from None
    model = fit(spectrum)
    return ChannelNoise(
        channel,
        float(np.std(channel.values)),
        len(np.unique(channel.values)),
        model,
        fit(spectrum, FILTER_PARTS),
        allan_deviation(channel.values, period_s, model.dominant),
        misfit(spectrum, model),
    )


def of_axis(found: Sequence[ChannelNoise], axis: str) -> tuple[list[ChannelNoise], list[ChannelNoise]]:
    """The gyro about an axis, and the accelerometers across it, whose angle is the tilt; all where axes are not
    known."""
    gyros, accels = ([one for one in found if one.channel.rate is rate] for rate in (True, False))
    about = [one for one in gyros if one.channel.axis == axis] or gyros
    across = [one for one in accels if one.channel.axis != axis] or accels
    return about, across


def filter_noise(
    found: Sequence[ChannelNoise], system: str, tuning_name: str | None, period_us: int | None, axis: str
) -> FilterNoise:
    """Q and R of a system's tuning. period_us: of its steps, None: the tuning's own. axis: of a three-axis recording,
    for systems with one axis; the others take the largest of all axes.

    Raises UsageError for a system or tuning that there is not, and one without such a filter.
    """
    chosen, tuning = chosen_settings.named_tuning(system, tuning_name)
    if period_us is not None:
        tuning = _with_period(tuning, period_us)
    gyros, accels = of_axis(found, axis if isinstance(tuning, AxisTuning) else "")
    if not gyros or not accels:
        raise UsageError("the recording lacks a gyro or an accelerometer: Q and R need both")
    white = max((one.as_filter.white for one in gyros), key=lambda one: one.value)
    walk = max((one.as_filter.walk for one in gyros), key=lambda one: one.value or one.high)
    accel = max((one.as_filter.white for one in accels), key=lambda one: one.value)
    walk_dps, walk_note = _walk_to_use(walk)
    deg_per_g = math.degrees(1.0)
    values = chosen_settings.named(
        tuning,
        {
            "q_angle_deg2_per_s": white.value**2,
            "q_bias_dps2_per_s": walk_dps**2,
            "r_deg2": (deg_per_g * accel.value) ** 2 / tuning.period_s,
        },
    )
    notes = {
        "q_angle_deg2_per_s": f"square of the gyro's white noise, {white.value:.3g} deg/s/sqrt(Hz)",
        "q_bias_dps2_per_s": walk_note,
        "r_deg2": (
            f"accelerometer's white noise, {accel.value:.3g} g/sqrt(Hz), as an angle at level, in a sample every "
            f"{1e3 * tuning.period_s:g} ms"
        ),
    }
    if not {name.rpartition(".")[2] for name in values} >= set(notes):
        raise UsageError(f"{system} has no filter with Q of angle and bias and an R: leave --system out")
    tuning = chosen_settings.changed(tuning, values)
    return FilterNoise(system, chosen, tuning, values, notes, chosen_settings.refusal(tuning))


def _walk_to_use(walk: Estimate) -> tuple[float, str]:
    """deg/s/sqrt(s) of the bias, and why."""
    if walk.value > 0.0 and walk.low > 0.0:
        return walk.value, f"square of the walk of the gyro's bias, {walk.value:.3g} deg/s/sqrt(s)"
    return walk.high, (
        f"square of {walk.high:.3g} deg/s/sqrt(s), the most that the bias can walk: the recording is too short to show "
        "it, and a filter with less would not follow a bias that drifts"
    )


def _with_period(tuning: AnyTuning, period_us: int) -> AnyTuning:
    if not 500 <= period_us <= 100_000:
        raise UsageError(f"a period of {period_us} us is outside 500 to 100000 us")
    return replace(tuning, period_us=period_us, exact_period_s=None)

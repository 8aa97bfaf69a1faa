"""From a test in closed loop to the plant: frequency response with its scatter, then gain, lag, delay and damping.

The setpoint swings by a sum of sines that repeats. The loop feeds noise of the sensors back into the command, so the
ratio of rate to command would be biased; both are related to the setpoint instead, which no noise reaches:

    response at a line = sum over periods of (rate conj(setpoint)) / sum of (command conj(setpoint))

The scatter of the periods says how well each line is known, and weighs it in the fit of the plant's parameters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.analyses.identification.noise_fit import Estimate
from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray
from plumb.tuning.loop_model import PlantModel

SINES, STEP = "sines", "step"
"""Test signals."""
REPEAT_S = 4.0
LINES = 16
HIGHEST_HZ = 8.0
"""Highest line; above it motors follow little, and noise covers the rest."""
SEED = 20
LEAST_PERIODS = 3
WORST_SCATTER = 0.5
"""A line whose response scatters by more than this share is left out."""
LEAST_LINES = 6
LEAST_RATIO = 4.0
"""Least ratio of a line of a signal to its scatter."""
NEIGHBOURS = 2
"""Lines on either side whose scatter counts for a line, too."""
NAMES = ("gain_dps2", "lag_s", "delay_s", "damping_per_s")
START = (0.05, 0.005, 0.5)
"""Lag (s), delay (s) and damping (1/s) from which the fit begins."""


@dataclass(frozen=True)
class Excitation:
    """A sum of sines that repeats: setpoint_deg, (samples,) of one period; lines: in cycles of it, (lines,)."""

    period_s: float
    setpoint_deg: FloatArray
    lines: npt.NDArray[np.int_]

    @property
    def hz(self) -> FloatArray:
        return np.asarray(self.lines / (len(self.setpoint_deg) * self.period_s), np.float64)


def excitation(period_s: float, amplitude_deg: float, test: str = SINES) -> Excitation:
    """The test signal for steps of a period, with its largest value: a sum of sines, or steps up and down. Raises
    UsageError for a period too long."""
    samples = round(REPEAT_S / period_s)
    highest = min(HIGHEST_HZ, 0.4 / period_s) * samples * period_s
    if test == STEP:  # a square wave has its odd harmonics alone
        square = np.where(np.arange(samples) < samples // 2, amplitude_deg, -amplitude_deg)
        return Excitation(period_s, np.asarray(square, np.float64), np.arange(1, math.floor(highest) + 1, 2))
    lines = np.unique(np.rint(np.geomspace(1.0, highest, LINES)).astype(np.int_))
    if len(lines) < LEAST_LINES:
        raise UsageError(f"steps of {1e3 * period_s:g} ms are too slow for a test of the loop")
    angle = 2.0 * np.pi * np.outer(np.arange(samples), lines) / samples
    rng = np.random.default_rng(SEED)
    # Phases of many draws: those whose sum has the lowest crest, so that the lines are large for a small swing.
    draws = [np.sum(np.cos(angle + rng.uniform(0.0, 2.0 * np.pi, len(lines))), axis=1) for _ in range(100)]
    signal = min(draws, key=lambda one: float(np.max(np.abs(one))))
    return Excitation(period_s, np.asarray(amplitude_deg * signal / np.max(np.abs(signal))), lines)


@dataclass(frozen=True)
class Measurement:
    """Signals of a test, (periods, samples) each: setpoint_deg as used, command, rate_dps of the gyro."""

    excitation: Excitation
    setpoint_deg: FloatArray
    command: FloatArray
    rate_dps: FloatArray


@dataclass(frozen=True)
class Response:
    """Frequency response at the lines that are known well enough: hz, value (deg/s per command), and its standard
    deviation."""

    hz: FloatArray
    value: npt.NDArray[np.complex128]
    deviation: FloatArray


@dataclass(frozen=True)
class PlantFit:
    """The plant, its parameters with 95 % intervals, and the measured response. mismatch: rms distance of response and
    model in standard deviations; about 1 where the model fits. apart: median of the distances, as a share of the
    response."""

    plant: PlantModel
    figures: dict[str, Estimate]
    response: Response
    mismatch: float
    apart: float


def response_of(test: Measurement) -> Response:
    """Raises UsageError where too few lines rise above the noise."""
    periods = len(test.command)
    if periods < LEAST_PERIODS:
        raise UsageError(f"{periods} periods of the test signal are too few: {LEAST_PERIODS} are needed")
    lines = test.excitation.lines
    asked, moved, turned = (
        np.fft.rfft(one, axis=1)[:, lines] for one in (test.setpoint_deg, test.command, test.rate_dps)
    )
    towards, across = turned * asked.conj(), moved * asked.conj()
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.sum(towards, axis=0) / np.sum(across, axis=0)
        left = towards - value * across
        deviation = np.sqrt(np.sum(np.abs(left) ** 2, axis=0) / (periods - 1) / periods) / np.abs(
            np.mean(across, axis=0)
        )
        known = np.isfinite(value) & (deviation < WORST_SCATTER * np.abs(value))
        known &= _above_noise(towards) & _above_noise(across)
    if int(np.sum(known)) < LEAST_LINES:
        raise UsageError(
            "the test signal does not rise above the noise: give a larger --amplitude or --periods, or move the stick "
            "more and for longer, and see that the machine can turn"
        )
    least = 1e-3 * np.abs(value[known])  # rounding of counts and command is not seen in the scatter
    share = _with_neighbours(deviation[known] / np.abs(value[known]))
    return Response(test.excitation.hz[known], value[known], np.maximum(share * np.abs(value[known]), least))


def _above_noise(spectrum: npt.NDArray[np.complex128]) -> npt.NDArray[np.bool_]:
    """Lines at which a signal follows the setpoint. Where it does not, a disturbance moves command and rate together:
    their ratio repeats well, and is that of the controller instead of the plant."""
    mean = np.mean(spectrum, axis=0)
    scatter = np.sqrt(np.sum(np.abs(spectrum - mean) ** 2, axis=0) / (len(spectrum) - 1) / len(spectrum))
    return np.asarray(np.abs(mean) > LEAST_RATIO * scatter, np.bool_)


def _with_neighbours(share: FloatArray) -> FloatArray:
    """Root of the mean square of each line's relative scatter and that of its neighbours. A few periods say little
    about the scatter of one line: one that happens to repeat well would outweigh all others in the fit."""
    square = np.pad(share**2, NEIGHBOURS, mode="edge")
    width = 2 * NEIGHBOURS + 1
    return np.asarray(np.sqrt(np.convolve(square, np.full(width, 1.0 / width), "valid")), np.float64)


def fit(test: Measurement) -> PlantFit:
    """The plant whose response is nearest to the measured one, in its standard deviations."""
    from scipy.optimize import least_squares

    response, period_s = response_of(test), test.excitation.period_s

    def plant_of(values: FloatArray) -> PlantModel:
        return PlantModel(math.exp(values[0]), math.exp(values[1]), float(values[2]), float(values[3]))

    def residuals(values: FloatArray) -> FloatArray:
        away = (plant_of(values).sampled(response.hz, period_s)[0] - response.value) / response.deviation
        return np.concatenate([away.real, away.imag]) * math.sqrt(2.0)  # the deviation is that of both together

    # Far below its corner the rate is the integral of the command: the first lines determine gain and sign.
    integral = response.value * 2j * math.pi * response.hz
    if float(np.median(integral.real)) < 0.0:
        raise UsageError(
            "a positive command turns the machine the wrong way: exchange the motors, or give esc.span_us the other "
            "sign"
        )
    lag_s, delay_s, damping_per_s = START
    start = np.array([math.log(float(np.max(np.abs(integral)))), math.log(lag_s), delay_s, damping_per_s])
    low, high = [0.0, math.log(1e-4), 0.0, 0.0], [math.log(1e9), math.log(2.0), 0.5, 100.0]
    found = least_squares(residuals, start, bounds=(low, high), x_scale=[0.3, 0.3, 0.01, 1.0])
    freedom = max(1, 2 * len(response.hz) - len(NAMES))
    mismatch = math.sqrt(float(np.sum(found.fun**2)) / freedom)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * max(1.0, mismatch**2)
    spread = 1.96 * np.sqrt(np.diag(covariance))
    figures = {}
    for index, (name, at, width) in enumerate(zip(NAMES, found.x.tolist(), spread.tolist(), strict=True)):
        ends = (at, at - width, at + width)
        if index < 2:  # gain and lag are fitted by their logarithms
            figures[name] = Estimate(*(math.exp(min(end, 700.0)) for end in ends))
        else:
            figures[name] = Estimate(*(max(end, 0.0) for end in ends))
    off = plant_of(found.x).sampled(response.hz, period_s)[0] / response.value - 1.0
    return PlantFit(plant_of(found.x), figures, response, mismatch, float(np.median(np.abs(off))))

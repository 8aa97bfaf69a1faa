"""White noise, bias instability and random walk of a signal at rest, by maximum likelihood, with confidence.

The signal is modelled as a constant with white noise of density N, flicker noise of bias instability B and a random
walk of density K. IEEE Std 952 defines the three by what each adds to the Allan variance at the averaging time tau:

    sigma^2(tau) = N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3

Reading them off the slopes of an Allan plot leaves out how uncertain they are, because neighbouring points of the plot
share their samples. Here the differences of neighbouring samples are transformed by the sine transform (DST-I), which
makes them independent: exactly for white noise and random walk, whose differences have a tridiagonal covariance, and
closely for flicker noise. The variance of coefficient j of n differences, at f = j / (2 (n + 1) period), is

    S(f) = 4 sin^2(pi f period) (N^2 + B^2 / (2 pi f)) / period + K^2 period

and N, B, K maximise the likelihood of all coefficients up to a highest frequency. A parameter's 95 % interval holds the
values at which the likelihood, with the others at their best, is at most 1.92 below its maximum (in logarithms).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray

FLICKER = 2.0 * math.log(2.0) / math.pi
"""Allan variance of flicker noise of bias instability 1."""
NAMES = ("white", "flicker", "walk")
BAND_SHARE = 0.25
"""Highest frequency used, of half the sampling rate: above it low-pass filters of sensors shape the noise."""
SINGLE, GROWTH = 64, 1.03
"""Coefficients that stand alone; above them they are taken together in bands, each so many times as wide."""
DROP = 1.92
"""Drop of the logarithm of the likelihood at the ends of a 95 % interval: half the 95 % quantile of chi-squared."""
LEAST_SAMPLES = 500
NEGLIGIBLE = 1e-9
"""A variance of this share of the power in its place explains nothing."""
STEPS_MAX, SHORTEST, PRECISION = 60, 1e-4, 1e-7
"""Limits of the search: steps, shortest share of one, and the gain of the logarithm of the likelihood at which it
ends."""
MISFIT, LEAST_MISFIT = 4.0, 0.25
"""A stretch of the spectrum is off if its power is so many standard deviations, and at least this share, off."""
RESOLUTION = 0.01
"""Accuracy of the logarithm of a variance at the end of an interval."""


@dataclass(frozen=True)
class Estimate:
    """A noise figure with its 95 % interval; value 0: the signal does not show it, and high is the most it can be."""

    value: float
    low: float
    high: float

    def scaled(self, factor: float) -> Estimate:
        return Estimate(factor * self.value, factor * self.low, factor * self.high)


@dataclass(frozen=True)
class NoiseModel:
    """Fitted noise, in the unit u of the signal: white N (u/sqrt(Hz)), flicker B (u), walk K (u/sqrt(s))."""

    white: Estimate
    flicker: Estimate
    walk: Estimate

    def allan_variance(self, tau_s: FloatArray) -> FloatArray:
        """Allan variance of the fitted model, (points,)."""
        return np.asarray(sum(self.parts(tau_s).values()))

    def parts(self, tau_s: FloatArray) -> dict[str, FloatArray]:
        """Share of each noise in the Allan variance, (points,)."""
        return {
            "white": self.white.value**2 / tau_s,
            "flicker": np.full_like(tau_s, FLICKER * self.flicker.value**2),
            "walk": self.walk.value**2 * tau_s / 3.0,
        }

    def dominant(self, tau_s: float) -> str:
        """The noise that adds most at an averaging time."""
        parts = self.parts(np.array([tau_s]))
        return max(parts, key=lambda name: float(parts[name][0]))


@dataclass(frozen=True)
class Misfit:
    """A stretch of the spectrum that the model does not explain. ratio: measured to fitted power."""

    low_hz: float
    high_hz: float
    ratio: float


class Spectrum:
    """Sine transform of a signal's differences, in bands: frequency_hz, power, count (bands,); basis (bands, 3)."""

    def __init__(self, values: FloatArray, period_s: float, highest_hz: float | None = None) -> None:
        """values: (n,) at a constant period. highest_hz: of the fit; None: BAND_SHARE of half the sampling rate.

        Raises UsageError for a signal that is too short, or that does not change.
        """
        from scipy.fft import dst

        if len(values) < LEAST_SAMPLES:
            raise UsageError(f"{len(values)} samples at rest are too few to measure noise: {LEAST_SAMPLES} or more")
        if float(np.ptp(values)) == 0.0:
            raise UsageError("the signal does not change at all: its noise is below the step of its counts")
        differences = np.diff(values)
        terms = len(differences)
        power = np.asarray(dst(differences, type=1, norm="ortho"), np.float64) ** 2
        angle = np.pi * np.arange(1, terms + 1) / (2.0 * (terms + 1))
        frequency_hz = angle / (np.pi * period_s)
        top_hz = BAND_SHARE / (2.0 * period_s) if highest_hz is None else highest_hz
        used = max(SINGLE, int(np.searchsorted(frequency_hz, top_hz * (1.0 + 1e-9))))
        high_pass = 4.0 * np.sin(angle) ** 2 / period_s
        basis = np.column_stack([high_pass, high_pass / (2.0 * np.pi * frequency_hz), np.full(terms, period_s)])
        starts = _starts(min(used, terms))
        self.count = np.diff([*starts, min(used, terms)]).astype(np.float64)
        self.power = np.add.reduceat(power[:used], starts) / self.count
        self.frequency_hz = np.add.reduceat(frequency_hz[:used], starts) / self.count
        self.basis = np.add.reduceat(basis[:used], starts, axis=0) / self.count[:, None]

    @cached_property
    def scale(self) -> FloatArray:
        """Variance of each noise that would explain all the power where it matters most, (3,)."""
        return np.asarray([float(np.max(self.power / column)) for column in self.basis.T])

    def loss(self, expected: FloatArray) -> float:
        """Minus the logarithm of the likelihood of expected variances, (bands,)."""
        return 0.5 * float(np.sum(self.count * (np.log(expected) + self.power / expected)))

    def best(self, parts: Sequence[int], fixed: dict[int, float] | None = None) -> tuple[float, dict[int, float]]:
        """Least loss over the variances of these parts, none negative, and the variances. fixed: those of others."""
        offset = np.zeros(len(self.power))
        for index, variance in (fixed or {}).items():
            offset += variance * self.basis[:, index]
        if not parts:
            return self.loss(offset), {}
        found = [self._descend(parts, offset, start) for start in _starting_points(self.scale[list(parts)])]
        loss, variances = min(found, key=lambda one: one[0])
        return loss, dict(zip(parts, variances.tolist(), strict=True))

    def _descend(self, parts: Sequence[int], offset: FloatArray, start: FloatArray) -> tuple[float, FloatArray]:
        """Fisher scoring: the power of a band has the variance 2 S^2 / count, so that each step is a weighted least
        square, with variances that are not negative."""
        from scipy.optimize import nnls

        basis, scale = self.basis[:, parts], self.scale[list(parts)]
        now, loss = start, self.loss(offset + basis @ start)
        for _ in range(STEPS_MAX):
            weight = np.sqrt(self.count) / (offset + basis @ now)
            aim = scale * nnls(basis * (weight[:, None] * scale), (self.power - offset) * weight)[0]
            share, lower = 1.0, math.inf
            while share > SHORTEST and not lower < loss:
                then = now + share * (aim - now)
                expected = offset + basis @ then
                lower = self.loss(expected) if float(np.min(expected)) > 0.0 else math.inf
                share *= 0.5
            if not lower < loss:
                return loss, now
            now, gained, loss = then, loss - lower, lower
            if gained < PRECISION:
                return loss, now
        return loss, now


def _starts(used: int) -> list[int]:
    """First coefficient of each band."""
    starts = list(range(min(SINGLE, used)))
    edge = float(SINGLE)
    while (start := max(round(edge), starts[-1] + 1)) < used:
        starts.append(start)
        edge = start * GROWTH
    return starts


def _starting_points(scale: FloatArray) -> list[FloatArray]:
    """Variances to start a search from: all parts alike, and each alone in front."""
    parts = len(scale)
    alike = [0.1 * scale]
    return alike + [scale * np.where(np.arange(parts) == one, 0.3, 1e-6) for one in range(parts if parts > 1 else 0)]


def fit(spectrum: Spectrum, parts: Sequence[str] = NAMES) -> NoiseModel:
    """The most likely noises, of these parts alone, with their intervals."""
    indices = [NAMES.index(name) for name in parts]
    least, variance = spectrum.best(indices)
    found = dict.fromkeys(NAMES, Estimate(0.0, 0.0, 0.0))
    for index in indices:
        found[NAMES[index]] = _estimate(spectrum, index, least, variance)
    return NoiseModel(**found)


def _estimate(spectrum: Spectrum, index: int, least: float, best: dict[int, float]) -> Estimate:
    """The figure of one part: square roots of its variance and of the ends of its interval."""
    others = [other for other in best if other != index]

    def above(variance: float) -> float:
        """Loss above the end of the interval, with the others at their best."""
        return spectrum.best(others, {index: variance})[0] - least - DROP

    def above_log(log_variance: float) -> float:
        return above(math.exp(log_variance))

    scale = float(spectrum.scale[index])
    centre = math.log(max(best[index], NEGLIGIBLE * scale))
    high = math.sqrt(math.exp(_crossing(above_log, centre, math.log(scale / NEGLIGIBLE))))
    if others and above(0.0) <= 0.0:
        return Estimate(math.sqrt(best[index]), 0.0, high)
    low = math.sqrt(math.exp(_crossing(above_log, centre, math.log(scale * NEGLIGIBLE))))
    return Estimate(math.sqrt(best[index]), low, high)


def _crossing(above: Callable[[float], float], centre: float, end: float) -> float:
    """The place where `above`, negative at centre, becomes positive on the way to end, by bisection; end if it does
    not."""
    step, inside = math.copysign(0.1, end - centre), centre
    while abs(step) < abs(end - centre) and above(centre + step) <= 0.0:
        inside, step = centre + step, 1.6 * step
    if abs(step) >= abs(end - centre):
        return end
    outside = centre + step
    while abs(outside - inside) > RESOLUTION:
        middle = 0.5 * (inside + outside)
        inside, outside = (inside, middle) if above(middle) > 0.0 else (middle, outside)
    return outside


def misfit(spectrum: Spectrum, model: NoiseModel) -> Misfit | None:
    """The stretch of the spectrum, of eight, that has most power beyond the model, else the one that lacks most; None
    if the model explains all of them."""
    variance = np.array([getattr(model, name).value ** 2 for name in NAMES])
    expected = spectrum.basis @ variance
    found: list[tuple[bool, float, Misfit]] = []
    edges = np.unique(np.geomspace(1, len(expected), 9).astype(int))
    for start, end in zip([0, *edges[:-1]], edges, strict=True):
        count = spectrum.count[start:end]
        ratio = float(np.sum(count * spectrum.power[start:end] / expected[start:end]) / np.sum(count))
        deviations = abs(ratio - 1.0) * math.sqrt(float(np.sum(count)) / 2.0)
        if deviations > MISFIT and abs(ratio - 1.0) > LEAST_MISFIT:
            band = Misfit(float(spectrum.frequency_hz[start]), float(spectrum.frequency_hz[end - 1]), ratio)
            found.append((ratio > 1.0, deviations, band))
    return max(found, key=lambda one: one[:2])[2] if found else None

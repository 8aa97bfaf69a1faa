"""Sideways acceleration of a run of `quad`: vibration in a band of frequencies, which fades in, and lateral bursts.

A plant that moves needs it at every point of the grid (`on_grid`). A prescribed motion is sampled once a period, behind
the accelerometer's low-pass: `low_passed` computes those values alone, from the few lines of the vibration's spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.physics.sensors import OnePole, band_noise
from plumb.spec.arrays import FloatArray

GRID_S = 0.001
"""Step of the simulated physics, and of signals that are filtered before they are sampled."""
VIBRATION_G, VIBRATION_HZ = 0.03, (2.0, 12.0)
FADE_FROM_S, FADE_S = 5.0, 2.0
BURST_G, BURST_S = 0.3, 0.15
BURST_REACH_S = 28.0 * BURST_S
"""Beyond it a burst is 0 in float64."""
BURST_SEEN_S = 6.0 * BURST_S
"""Beyond it a burst is below 1e-16 g, which no sample shows."""

ComplexArray = npt.NDArray[np.complex128]


def fade(time_s: FloatArray) -> FloatArray:
    """The share of the vibration, and of the motion, from 0 to 1."""
    return np.clip((time_s - FADE_FROM_S) / FADE_S, 0.0, 1.0)


@dataclass(frozen=True)
class Lateral:
    """white: unit white noise on the grid, (points,), of which the vibration is made. burst_s, burst_g: middle and peak
    of the bursts. still: there is no lateral acceleration, whatever was drawn."""

    white: FloatArray
    burst_s: FloatArray
    burst_g: FloatArray
    still: bool = False

    @cached_property
    def on_grid(self) -> FloatArray:
        """In g at every point of the grid, the last one included, (points + 1,)."""
        points = len(self.white)
        if self.still:
            return np.zeros(points + 1)
        vibration = band_noise(self.white, *VIBRATION_HZ, GRID_S)
        whole: FloatArray = VIBRATION_G * np.append(vibration, vibration[0]) * fade(_grid_s(points))
        for near, burst in self._bursts(BURST_REACH_S):
            whole[near] += burst
        return whole

    def low_passed(self, pole: OnePole, stride: int) -> FloatArray | None:
        """In g behind a low-pass at every stride-th point of the grid, (points / stride,). None where this way is not
        open: a run that is no whole number of strides, a fade that begins or ends within one, strides too long for the
        vibration's frequencies."""
        points = len(self.white)
        knees = (FADE_FROM_S / (stride * GRID_S), (FADE_FROM_S + FADE_S) / (stride * GRID_S))
        first, last = _lines(points)
        if points % stride or last > points // stride // 2 or any(abs(knee - round(knee)) > 1e-6 for knee in knees):
            return None
        samples = points // stride
        if self.still:
            return np.zeros(samples)
        # From one sample to the next the low-pass keeps decay^stride of its output and adds a sum over the stride's
        # points, whose weights are those of its own step. The fade is linear within a stride.
        weights = _weights(pole, stride)
        spectrum = self._spectrum(stride, first, last)
        level, slope = _sums(spectrum, weights, points, first, samples)
        at_sample = fade(np.arange(samples + 1, dtype=np.float64) * (stride * GRID_S))
        new = VIBRATION_G * (at_sample[:-1] * level + np.diff(at_sample) * slope)
        if len(self.burst_s):
            bursts = np.zeros(points + 1)
            for near, burst in self._bursts(BURST_SEEN_S):
                bursts[near] += burst
            new += bursts[:-1].reshape(samples, stride) @ weights[:-1] + weights[-1] * bursts[stride::stride]
        return _recurred(new, pole.decay**stride)

    def _bursts(self, reach_s: float) -> list[tuple[slice, FloatArray]]:
        """Where on the grid each burst is within its reach, and its acceleration there."""
        grid_s, found = _grid_s(len(self.white)), []
        for at_s, peak_g in zip(self.burst_s, self.burst_g, strict=True):
            near = slice(*np.searchsorted(grid_s, (at_s - reach_s, at_s + reach_s)))
            found.append((near, peak_g * np.exp(-(((grid_s[near] - at_s) / BURST_S) ** 2))))
        return found

    def _spectrum(self, stride: int, first: int, last: int) -> ComplexArray:
        """The lines of the vibration, scaled to unit rms: the transform of the white noise at the lines of its band.
        They lie below half the sampling rate, so that one transform for each point of a stride is enough."""
        points = len(self.white)
        parts = np.fft.rfft(self.white.reshape(-1, stride), axis=0)[first : last + 1]
        lines: ComplexArray = np.einsum("ij,ij->i", parts, _turns(points, stride, first, last))
        power = 2.0 * float(np.sum(lines.real**2 + lines.imag**2)) / points**2
        return np.asarray(lines / np.sqrt(power))


def check(points: int) -> None:
    """Raises UsageError for a run that is too short for the vibration."""
    first, last = _lines(points)
    if last < first:
        raise UsageError(f"vibration of {VIBRATION_HZ[0]:g} Hz and more needs a longer run")


@lru_cache(maxsize=16)
def _grid_s(points: int) -> FloatArray:
    return np.arange(points + 1, dtype=np.float64) * GRID_S


@lru_cache(maxsize=16)
def _lines(points: int) -> tuple[int, int]:
    """Numbers of the first and the last line of the spectrum in the band."""
    f_hz = np.fft.rfftfreq(points, GRID_S)
    inside = np.flatnonzero((f_hz >= VIBRATION_HZ[0]) & (f_hz <= VIBRATION_HZ[1]))
    return (int(inside[0]), int(inside[-1])) if len(inside) else (1, 0)


@lru_cache(maxsize=4)
def _turns(points: int, stride: int, first: int, last: int) -> ComplexArray:
    """exp(-2 pi i line point / points), (lines, stride)."""
    at = np.outer(np.arange(first, last + 1), np.arange(stride))
    return np.asarray(np.exp(-2j * np.pi * at / points))


@lru_cache(maxsize=16)
def _weights(pole: OnePole, stride: int) -> FloatArray:
    """What each point from one sample to the next, both included, adds to the output at the next, (stride + 1,)."""
    weights = np.zeros(stride + 1)
    weights[1:] += pole.new * pole.decay ** np.arange(stride - 1, -1, -1.0)
    weights[:-1] += pole.old * pole.decay ** np.arange(stride - 1, -1, -1.0)
    return weights


def _sums(
    spectrum: ComplexArray, weights: FloatArray, points: int, first: int, samples: int
) -> tuple[FloatArray, FloatArray]:
    """Of the vibration over each stride: the sum with the weights, and that with the weights times the share of the
    stride that has passed; (samples,) each."""
    found = []
    for response in _responses(weights.tobytes(), points, first, first + len(spectrum)):
        lines = np.zeros(samples // 2 + 1, np.complex128)
        lines[first : first + len(spectrum)] = spectrum * response
        found.append(np.fft.irfft(lines, samples) * (samples / points))
    return found[0], found[1]


@lru_cache(maxsize=4)
def _responses(weights: bytes, points: int, first: int, end: int) -> tuple[ComplexArray, ComplexArray]:
    """What the two sums of `_sums` make of every line."""
    given = np.frombuffer(weights, np.float64)
    stride = len(given) - 1
    ahead = np.exp(2j * np.pi * np.outer(np.arange(first, end), np.arange(stride + 1)) / points)
    return ahead @ given, ahead @ (given * np.arange(stride + 1) / stride)


def _recurred(new: FloatArray, keep: float) -> FloatArray:
    """y[0] = 0, y[k + 1] = keep y[k] + new[k]; (len(new),)."""
    memory = 1 if keep < 1e-300 else min(len(new), 2 + int(np.ceil(-40.0 / np.log(keep))))
    response = np.convolve(new[:-1], keep ** np.arange(memory))[: len(new) - 1]
    return np.concatenate([[0.0], response])

"""Sensor models: ENC-03 gyro and MMA7260 accelerometer with the ADC, ADXL345 and ITG-3205, and faults of a channel.

Physical values with bias and noise in, volts or counts out. The caller draws the noise, once per sample, so that
reading twice gives the same value. Constants are those of the published quadrotor design (Feng et al. 2011) or of the
data sheets unless a line says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from plumb.contract.disturbance import Request
from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel

ADC_REFERENCE_V = 3.3
ADC_COUNTS = 4096
ADC_NOISE_LSB = 0.7
"""Standard deviation before rounding, of all noise sources up to the converter together (assumed)."""


def adc_counts(volts: npt.ArrayLike) -> npt.NDArray[np.int16]:
    """Counts of the F103's 12-bit ADC for pin volts: round(V * 4096 / 3.3), clipped to 0..4095; same shape as volts."""
    lsb = np.asarray(volts, np.float64) * (ADC_COUNTS / ADC_REFERENCE_V)
    return np.clip(np.rint(lsb), 0, ADC_COUNTS - 1).astype(np.int16)


@dataclass(frozen=True)
class Enc03:
    """Murata ENC-03 gyro: one axis, analog, saturates at +-range_dps."""

    zero_v: float = 1.35
    v_per_dps: float = 0.67e-3
    range_dps: float = 300.0

    def volts(self, rate_dps: FloatArray) -> FloatArray:
        """Output volts for a rate in deg/s that includes bias and noise; any shape."""
        return self.zero_v + self.v_per_dps * np.clip(rate_dps, -self.range_dps, self.range_dps)

    def channel(self) -> Channel:
        """Calibration by the data sheet. Counts more than a tenth beyond the range are clamped and count as
        saturated."""
        return _channel(self.zero_v, self.v_per_dps, 1.1 * self.range_dps)


@dataclass(frozen=True)
class Mma7260:
    """Freescale MMA7260 on its 1.5 g range, followed by a one-pole low-pass of bandwidth_hz."""

    bandwidth_hz: float = 350.0
    zero_v: float = 1.65
    v_per_g: float = 0.8
    range_g: float = 1.5
    noise_g_per_rthz: float = 350e-6

    @property
    def noise_g(self) -> float:
        """Noise after the low-pass, rms: 350 ug * sqrt(1.5 * bandwidth).

        The printed 1.5 is pi/2 rounded, the noise bandwidth of one pole; pi/2 gives the 8.2 mg stated for 350 Hz.
        """
        return self.noise_g_per_rthz * math.sqrt(math.pi / 2.0 * self.bandwidth_hz)

    def volts(self, accel_g: FloatArray) -> FloatArray:
        """Output volts for a filtered specific force in g that includes offset and noise; any shape."""
        return self.zero_v + self.v_per_g * np.clip(accel_g, -self.range_g, self.range_g)

    def channel(self) -> Channel:
        """Calibration by the data sheet. Counts more than a tenth beyond the range are clamped."""
        return _channel(self.zero_v, self.v_per_g, 1.1 * self.range_g)


def _channel(zero_v: float, v_per_unit: float, range_units: float) -> Channel:
    counts_per_v = ADC_COUNTS / ADC_REFERENCE_V
    zero, span = zero_v * counts_per_v, range_units * v_per_unit * counts_per_v
    return Channel(
        zero_counts=zero,
        unit_per_count=1.0 / (v_per_unit * counts_per_v),
        min_counts=max(0, math.floor(zero - span)),
        max_counts=min(ADC_COUNTS - 1, math.ceil(zero + span)),
    )


@dataclass(frozen=True)
class Adxl345:
    """Analog Devices ADXL345 in full resolution on its 16 g range: forward (x) and up (z), 3.9 mg per count."""

    g_per_lsb: float = 3.9e-3
    range_lsb: int = 4096
    noise_lsb: tuple[float, float] = (0.75, 1.1)
    """Standard deviation of x and z at 100 Hz."""

    def counts(self, accel_g: FloatArray) -> npt.NDArray[np.int16]:
        """Contents of the data registers for a specific force in g that includes offset and noise; any shape."""
        return np.clip(np.rint(accel_g / self.g_per_lsb), -self.range_lsb, self.range_lsb - 1).astype(np.int16)

    def channel(self, forward: bool = True) -> Channel:
        """Calibration by the data sheet; forward: a positive count is a positive value, False: a negative one."""
        return Channel(0.0, self.g_per_lsb if forward else -self.g_per_lsb, -self.range_lsb + 1, self.range_lsb - 2)


@dataclass(frozen=True)
class Itg3205:
    """InvenSense ITG-3205: +-2000 deg/s, 14.375 counts per deg/s."""

    lsb_per_dps: float = 14.375

    def counts(self, rate_dps: FloatArray) -> npt.NDArray[np.int16]:
        """Contents of the data registers for a rate in deg/s that includes bias and noise; any shape."""
        return np.clip(np.rint(rate_dps * self.lsb_per_dps), -32768, 32767).astype(np.int16)

    def channel(self) -> Channel:
        """Calibration by the data sheet. Counts more than a tenth beyond the range are clamped and count as
        saturated."""
        most = round(2200.0 * self.lsb_per_dps)
        return Channel(0.0, 1.0 / self.lsb_per_dps, -most, most)


def band_noise(white: FloatArray, low_hz: float, high_hz: float, step_s: float) -> FloatArray:
    """White noise limited to a band of frequencies and scaled to unit rms, shape (n,); raises UsageError when the run
    is too short for the band."""
    spectrum, f = np.fft.rfft(white), np.fft.rfftfreq(len(white), step_s)
    inside = (f >= low_hz) & (f <= high_hz)
    if not inside.any():
        raise UsageError(f"motion of {low_hz:g} to {high_hz:g} Hz needs a run of at least {1.0 / high_hz:.2g} s")
    spectrum[~inside] = 0.0
    cut = np.fft.irfft(spectrum, len(white))
    return np.asarray(cut / np.sqrt(np.mean(cut * cut)), np.float64)


@dataclass(frozen=True)
class OnePole:
    """First-order low-pass, exact for input that is linear between samples: y = decay y' + new x + old x', where ' is
    the previous sample."""

    decay: float
    new: float
    old: float

    @classmethod
    def of(cls, bandwidth_hz: float, step_s: float) -> OnePole:
        """The filter with its -3 dB corner at bandwidth_hz, above 0, for samples every step_s."""
        if not bandwidth_hz > 0.0:
            raise UsageError(f"a bandwidth of {bandwidth_hz} Hz lets nothing through; give one above 0")
        steps = 1.0 / (2.0 * math.pi * bandwidth_hz * step_s)
        decay = math.exp(-1.0 / steps)
        return cls(decay, 1.0 - steps * (1.0 - decay), steps * (1.0 - decay) - decay)

    def run(self, signal: FloatArray) -> FloatArray:
        """The filtered signal, shape (n,); before its beginning the signal had its first value."""
        drive = self.new * signal[1:] + self.old * signal[:-1] - (1.0 - self.decay) * signal[0]
        memory = 1 if self.decay == 0.0 else min(len(signal), 2 + math.ceil(-40.0 / math.log(self.decay)))
        response = np.convolve(drive, self.decay ** np.arange(memory))[: len(drive)]
        return np.asarray(signal[0] + np.concatenate([[0.0], response]), np.float64)


FaultKind = Literal["railed", "stuck", "noisy", "silent", "flickering", "amplified", "missing"]
FAULT_KINDS: tuple[FaultKind, ...] = ("railed", "stuck", "noisy", "silent")
DIGITAL_FAULT_KINDS: tuple[FaultKind, ...] = (*FAULT_KINDS, "flickering", "amplified", "missing")
"""Those of a sensor with a bus, whose counts the system reads as they are. The places are those of plant.h."""
FAULT_NOISE_V, FAULT_NOISE_LSB, FAULT_RAIL_LSB, FAULT_NO_SAMPLE = 0.1, 200.0, 32767, -32768
FLICKER_SIGMA, AMPLIFIED = 2.4, 8.0
"""Noise beyond which a flickering channel is at its rail, 1 sample of 61; counts of a range that is an eighth."""


FAULT_NOTES = {
    "railed": "a channel at the end of its scale",
    "stuck": "a channel frozen at its last value",
    "noisy": f"a channel with {FAULT_NOISE_V:g} V, or {FAULT_NOISE_LSB:g} counts, rms of additional noise",
    "silent": "a channel that is dead: 0 V, or zero",
}
DIGITAL_FAULT_NOTES = {
    **FAULT_NOTES,
    "flickering": "a channel at the end of its scale in one sample of 61",
    "amplified": f"a channel whose range fell back: {AMPLIFIED:g} times the counts",
    "missing": "a channel without a sample",
}


@dataclass(frozen=True)
class Fault:
    """A faulty channel for start_s <= time < stop_s; FAULT_NOTES describes the kinds."""

    kind: FaultKind
    channel: int
    start_s: float
    stop_s: float = math.inf

    def volts(self, volts: FloatArray, time_s: FloatArray, volts_at_start: float, noise: FloatArray) -> FloatArray:
        """Volts at the pin. volts, time_s, noise: same shape; noise: unit white noise of these samples."""
        instead: FloatArray | float
        match self.kind:
            case "railed":
                instead = ADC_REFERENCE_V
            case "stuck":
                instead = volts_at_start
            case "noisy":
                instead = volts + FAULT_NOISE_V * noise
            case "silent":
                instead = 0.0
            case _:
                raise UsageError(f"'{self.kind}' is no sensor fault; use railed, stuck, noisy or silent")
        return np.where((time_s >= self.start_s) & (time_s < self.stop_s), instead, volts)

    def counts(
        self, counts: npt.NDArray[np.int16], time_s: FloatArray, counts_at_start: int, noise: FloatArray
    ) -> npt.NDArray[np.int16]:
        """Counts in the data register of a digital sensor; arguments as of volts()."""
        instead: FloatArray | float
        match self.kind:
            case "railed":
                instead = FAULT_RAIL_LSB
            case "stuck":
                instead = counts_at_start
            case "noisy":
                instead = np.clip(np.rint(counts + FAULT_NOISE_LSB * noise), -32768, 32767)
            case "silent":
                instead = 0.0
            case "flickering":
                instead = np.where(np.abs(noise) > FLICKER_SIGMA, FAULT_RAIL_LSB, counts)
            case "amplified":
                instead = np.clip(counts * AMPLIFIED, -32768, 32767)
            case "missing":
                instead = FAULT_NO_SAMPLE
            case _:
                raise UsageError(f"'{self.kind}' is no sensor fault; use {', '.join(DIGITAL_FAULT_KINDS)}")
        return np.where((time_s >= self.start_s) & (time_s < self.stop_s), instead, counts).astype(np.int16)


@dataclass(frozen=True)
class Push:
    """A push on the plant for start_s <= time < stop_s; size: in the unit of the system."""

    size: float
    start_s: float
    stop_s: float


def fault_of(asked: Request, channels: Sequence[str], kinds: Sequence[FaultKind] = FAULT_KINDS) -> Fault:
    """The sensor fault that a request names; raises UsageError for an unknown kind or channel. channels: names in the
    order of the raw counts."""
    for kind in kinds:
        if kind == asked.kind and asked.what in channels:
            return Fault(kind, list(channels).index(asked.what), asked.start_s, asked.stop_s)
    said = f"{asked.kind}:{asked.what}" if asked.what else asked.kind
    raise UsageError(f"there is no fault '{said}' here; there are {', '.join(kinds)} of {', '.join(channels)}")


def faults_of(requests: Sequence[Request], channels: Sequence[str], push_unit: str) -> tuple[Fault | Push, ...]:
    """The faults and pushes that the requests name; raises UsageError for an unknown kind or channel."""
    found: list[Fault | Push] = []
    for asked in requests:
        if asked.kind == "push":
            found.append(Push(asked.number(push_unit), asked.start_s, asked.stop_s))
        else:
            found.append(fault_of(asked, channels))
    return tuple(found)

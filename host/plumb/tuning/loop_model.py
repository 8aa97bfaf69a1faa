"""The attitude loop as frequency responses: plant with delay, filter and PID as they are sampled; margins.

The plant is what a command moves: a torque behind a first-order lag and a delay turns a body,

    rate / command = gain e^(-s delay) / ((s + damping) (1 + s lag)),    tilt = rate / s

The command is held for a step. The response of a sampled signal is the sum over its aliases, so that it holds up to
half the rate of the steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from plumb.kernels.reference.kernels import driving_rate
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import AxisTuning, Pid

Response = npt.NDArray[np.complex128]
G = TypeVar("G")
G_contra = TypeVar("G_contra", contravariant=True)
ALIASES = 4
GRID_POINTS = 600
LOWEST_HZ = 0.02
COVARIANCE_STEPS = 20_000
SETTLED = 1e-9
NEAR_HALF_TURN_DEG = 5.0


@dataclass(frozen=True)
class PlantModel:
    """gain_dps2: deg/s^2 per unit of command; lag_s, delay_s; damping_per_s."""

    gain_dps2: float
    lag_s: float
    delay_s: float
    damping_per_s: float = 0.0

    def _rate(self, s: Response) -> Response:
        turned = self.gain_dps2 * np.exp(-s * self.delay_s)
        return np.asarray(turned / ((s + self.damping_per_s) * (1.0 + s * self.lag_s)))

    def sampled(self, hz: FloatArray, period_s: float) -> tuple[Response, Response]:
        """Rate (deg/s) and tilt (deg) at the samples, per unit of a command that is held for a period."""
        rate, tilt = np.zeros(len(hz), np.complex128), np.zeros(len(hz), np.complex128)
        hold = 1.0 - np.exp(-2j * math.pi * hz * period_s)
        for alias in range(-ALIASES, ALIASES + 1):
            s = np.asarray(2j * math.pi * (hz + alias / period_s), np.complex128)
            one = self._rate(s) * hold / (s * period_s)
            rate += one
            tilt += one / s
        return rate, tilt


class LoopController(Protocol[G_contra]):
    """Estimator and controller as they are sampled, for gains of one kind."""

    @property
    def period_s(self) -> float: ...

    def estimate(self, hz: FloatArray, rate: Response, tilt: Response, /) -> tuple[Response, Response]:
        """Tilt and rate as the controller has them, of these samples of rate and tilt."""

    def command(self, hz: FloatArray, estimated: Response, corrected: Response, gains: G_contra, /) -> Response:
        """Minus the command that the controller makes of them at setpoint 0."""


@dataclass(frozen=True)
class Controller:
    """Filter and PID of a one-axis tuning at its steady gains. r_deg2: R of the measurement, as it is on average."""

    tuning: AxisTuning
    r_deg2: float

    @property
    def period_s(self) -> float:
        return self.tuning.period_s

    def steady_gains(self) -> tuple[float, float]:
        """K of tilt and bias after many steps with this R."""
        ts, kalman = self.tuning.period_s, self.tuning.kalman
        q_angle, q_bias = kalman.q_angle_deg2_per_s * ts, kalman.q_bias_dps2_per_s * ts
        p00, p01, p11 = self.r_deg2, 0.0, 1.0
        k0 = k1 = 0.0
        for _ in range(COVARIANCE_STEPS):
            p00 += q_angle - ts * (2.0 * p01 - ts * p11)
            p01 -= ts * p11
            p11 += q_bias
            before = k0, k1
            k0, k1 = p00 / (p00 + self.r_deg2), p01 / (p00 + self.r_deg2)
            p11, p00, p01 = p11 - k1 * p01, p00 * (1.0 - k0), p01 * (1.0 - k0)
            if abs(k0 - before[0]) < SETTLED * k0 and abs(k1 - before[1]) < SETTLED * abs(k1):
                break
        return k0, k1

    def estimate(self, hz: FloatArray, rate: Response, tilt: Response) -> tuple[Response, Response]:
        """Estimated tilt, and the rate less the estimated bias, of these samples of rate and tilt."""
        ts, (k0, k1) = self.tuning.period_s, self.steady_gains()
        back = np.exp(-2j * math.pi * hz * ts)
        driven = ts * np.asarray(driving_rate(self.tuning.kalman.rate, rate, back * rate))
        # tilt^ = (1 - k0) (back tilt^ + driven - ts back bias^) + k0 tilt
        # bias^ = back bias^ + k1 (tilt - back tilt^ - driven + ts back bias^)
        a11, a12 = 1.0 - (1.0 - k0) * back, (1.0 - k0) * ts * back
        a21, a22 = k1 * back, 1.0 - back - k1 * ts * back
        b1, b2 = (1.0 - k0) * driven + k0 * tilt, k1 * (tilt - driven)
        determinant = a11 * a22 - a12 * a21
        estimated = (a22 * b1 - a12 * b2) / determinant
        bias = (a11 * b2 - a21 * b1) / determinant
        return np.asarray(estimated), np.asarray(rate - bias)

    def command(self, hz: FloatArray, estimated: Response, corrected: Response, pid: Pid) -> Response:
        """Minus the command that the PID makes of them at setpoint 0."""
        ts = self.tuning.period_s
        back = np.exp(-2j * math.pi * hz * ts)
        alpha = 1.0 - math.exp(-ts / pid.derivative_tau_s) if pid.derivative_tau_s else 1.0
        filtered = corrected * alpha / (1.0 - (1.0 - alpha) * back)
        straight = pid.kp_per_deg + pid.ki_per_deg_s * ts * back / (1.0 - back)
        return np.asarray(straight * estimated + pid.kd_per_dps * filtered)


@dataclass(frozen=True)
class Margins:
    """phase_deg at crossover_hz, where the loop gain is 1; gain_db: the loop may grow by so much, lower_gain_db:
    shrink; delay_s: further delay that the phase margin allows; peak: of the sensitivity. stable: as the crossings
    say."""

    stable: bool
    crossover_hz: float
    phase_deg: float
    gain_db: float
    lower_gain_db: float
    delay_s: float
    peak: float


class Loop(Generic[G]):
    """A plant under a controller: the loop broken at the command. hz: a logarithmic grid up to half the step rate."""

    def __init__(self, plant: PlantModel, controller: LoopController[G], hz: FloatArray | None = None) -> None:
        period_s = controller.period_s
        self.hz: FloatArray = np.geomspace(LOWEST_HZ, 0.499 / period_s, GRID_POINTS) if hz is None else hz
        self.controller, self.plant = controller, plant
        self.rate, self.tilt = plant.sampled(self.hz, period_s)
        self._estimated, self._corrected = controller.estimate(self.hz, self.rate, self.tilt)

    def gain(self, gains: G) -> Response:
        """The loop gain with these gains of the controller."""
        return self.controller.command(self.hz, self._estimated, self._corrected, gains)

    def closed(self, hz: FloatArray, gains: G) -> Response:
        """Response of the tilt to the setpoint, at any frequencies above 0."""
        there = Loop(self.plant, self.controller, hz)
        ones, zeros = np.ones(len(hz), np.complex128), np.zeros(len(hz), np.complex128)
        straight = self.controller.command(hz, ones, zeros, gains)
        return np.asarray(there.tilt * straight / (1.0 + there.gain(gains)))

    def margins(self, gains: G) -> Margins:
        return margins(self.hz, self.gain(gains))


def margins(hz: FloatArray, loop: Response) -> Margins:
    """Margins of a loop gain whose plant has no unstable pole. The loop is stable if it crosses 1 once, downwards, with
    a phase above -180 deg, and is below 1 wherever the phase passes -180 deg after that."""
    size_db, phase = 20.0 * np.log10(np.abs(loop)), np.unwrap(np.angle(loop))
    # Integrators and a body that only friction brakes lie between -180 and -360 deg at low frequencies.
    phase -= 2.0 * math.pi * math.ceil((phase[0] - 1e-3) / (2.0 * math.pi))
    log_hz, degrees = np.log(hz), np.degrees(phase)
    crossings = np.flatnonzero((size_db[:-1] >= 0.0) != (size_db[1:] >= 0.0)).tolist()
    peak = float(np.max(1.0 / np.abs(1.0 + loop)))
    if len(crossings) != 1 or size_db[0] < 0.0:
        return Margins(False, math.nan, math.nan, math.nan, math.nan, math.nan, peak)
    share = _share(size_db, crossings[0], 0.0)
    at_hz = math.exp(_between(log_hz, crossings[0], share))
    phase_deg = 180.0 + _between(degrees, crossings[0], share)
    turns = [
        (index, _between(size_db, index, _share(degrees, index, level)))
        for level in (-180.0, -540.0)
        for index in np.flatnonzero((degrees[:-1] >= level) != (degrees[1:] >= level)).tolist()
    ]
    above = [-size for index, size in turns if index >= crossings[0]]
    below = [size for index, size in turns if index < crossings[0]]
    gain_db, lower_gain_db = min(above, default=math.inf), min(below, default=math.inf)
    stable = phase_deg > 0.0 and gain_db > 0.0 and lower_gain_db > 0.0
    return Margins(stable, at_hz, phase_deg, gain_db, lower_gain_db, phase_deg / 360.0 / at_hz, peak)


def _share(values: FloatArray, index: int, level: float) -> float:
    return float((level - values[index]) / (values[index + 1] - values[index]))


def _between(values: FloatArray, index: int, share: float) -> float:
    return float(values[index] + share * (values[index + 1] - values[index]))


def nearest_margins(hz: FloatArray, loop: Response) -> Margins:
    """Margins of a loop that is known to be stable, whatever its poles are without feedback: how far gain, phase and
    delay may go either way before it passes -1."""
    size_db, phase = 20.0 * np.log10(np.abs(loop)), np.degrees(np.unwrap(np.angle(loop)))
    log_hz = np.log(hz)
    crossings = []
    for index in np.flatnonzero((size_db[:-1] >= 0.0) != (size_db[1:] >= 0.0)).tolist():
        share = _share(size_db, index, 0.0)
        crossings.append((math.exp(_between(log_hz, index, share)), (180.0 + _between(phase, index, share)) % 360.0))
    turn = np.floor((phase + 180.0) / 360.0)  # changes where the phase passes -180 deg, or another odd half turn
    above, below = [math.inf], [math.inf]
    for index in np.flatnonzero(turn[:-1] != turn[1:]).tolist():
        level = 360.0 * max(turn[index], turn[index + 1]) - 180.0
        at_db = _between(size_db, index, _share(phase, index, level))
        (below if at_db > 0.0 else above).append(abs(at_db))
    for end in (0, -1):  # at frequency 0 and at half the step rate the gain is a real number, negative or positive
        if abs(phase[end] % 360.0 - 180.0) < NEAR_HALF_TURN_DEG:
            (below if size_db[end] > 0.0 else above).append(abs(float(size_db[end])))
    peak = float(np.max(1.0 / np.abs(1.0 + loop)))
    if not crossings:
        return Margins(True, math.nan, math.inf, min(above), min(below), math.inf, peak)
    at_hz, lag_deg = min(crossings, key=lambda one: min(one[1], 360.0 - one[1]))
    delay_s = min(lag / 360.0 / at for at, lag in crossings)
    return Margins(True, at_hz, min(lag_deg, 360.0 - lag_deg), min(above), min(below), delay_s, peak)

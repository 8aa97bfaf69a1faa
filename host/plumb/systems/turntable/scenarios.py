"""`turntable`: attitude from a gyro and an angular-acceleration sensor of different rates, on a three-axis turntable
(patent application of Beijing Institute of Technology, 2023: Wang, Zhai, Liu, Xiao).

Channels, in the order of the raw counts: gyro x, y, z, angular acceleration x, y, z; -32768 is no sample. A step is a
sample of the angular accelerometer, every 4 ms. The gyro samples every 10 ms at its own phase, which `Scenario.fit`
puts into the run's tuning: a sensor board knows when it samples. Axes are the body's; the attitude rotates the body
frame into the initial frame.

Assumed, not from a data sheet or the patent: gyro 0.03 deg/s/sqrt(Hz), lag 8 ms, bias +-1 deg/s; angular accelerometer
0.3 deg/s^2/sqrt(Hz), bias +-2 deg/s^2; both with a bias walk of 0.003 per sqrt(s), a scale error of 0.5 % and spikes of
20 sigma in 0.5 % of the samples. "Faded in over 3 s" is taken as a raised cosine, because a linear fade ends with a
jump of the rate, which a turntable cannot make. `untrimmed` has no lag and an uncalibrated gyro as in the data sheet
of the MPU-6050 (131 LSB per deg/s): sensitivity within 3 %, taken as two standard deviations. `analog` has both
sensors on the board's ADC, which samples them in every step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from plumb.contract.disturbance import Request
from plumb.errors import UsageError
from plumb.physics.sensors import ADC_COUNTS
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel
from plumb.systems.run_length import length_s
from plumb.systems.turntable.motion import REST_S, at, lagged, motion
from plumb.systems.turntable.settings import Fusion, Prefilter
from plumb.systems.turntable.tuning import TurntableTuning

PERIOD_US = 4_000
GYRO_PERIOD_S = 0.01
SUBSTEPS = 20
NO_SAMPLE, COUNT_MAX = -32768, 32767
GYRO_LSB_PER_DPS, ANGULAR_LSB_PER_DPS2 = 131.0, 20.0
ADC_LSB_PER_DPS, ADC_LSB_PER_DPS2 = 5.0, 1.0
"""LSB per deg/s and per deg/s^2 of sensors with analog outputs around half the supply, on the board's 12-bit ADC."""
SLOW_HZ, SLOW_DEG, QUICK_HZ, QUICK_DEG = (0.1, 0.3), (30.0, 60.0), (0.5, 1.2), (5.0, 12.0)
GYRO_BIAS_DPS, ANGULAR_BIAS_DPS2 = 1.0, 2.0
SPIKE_SIGMA = 20.0
WARM_UP_DPS, WARM_UP_TAU_S = 0.3, 60.0


@dataclass(frozen=True)
class Errors:
    """Sensor errors of a scenario: noise densities per root Hz, random walks per root s, scale errors as fractions."""

    gyro_dps: float = 0.03
    angular_dps2: float = 0.3
    walk_dps: float = 0.003
    walk_dps2: float = 0.003
    gyro_scale: float = 0.005
    angular_scale: float = 0.005
    lag_s: float = 0.008
    spike_share: float = 0.005
    bias: float = 1.0
    warm_up_dps: float = 0.0


ERRORS = {
    "motion": Errors(),
    "clean": Errors(spike_share=0.0),
    "white": Errors(walk_dps=0.0, walk_dps2=0.0, gyro_scale=0.0, angular_scale=0.0, spike_share=0.0, bias=0.0),
    "no_lag": Errors(lag_s=0.0),
    "warm_up": Errors(warm_up_dps=WARM_UP_DPS),
    "untrimmed": Errors(gyro_scale=0.015, lag_s=0.0),
    "analog": Errors(),
}
SCENARIOS = {
    "motion": "10 s at rest, 20 s of motion about three axes",
    "clean": "the same without spikes",
    "white": "white noise alone: no bias, walk, scale error or spikes; the gyro's lag stays",
    "no_lag": "the gyro without its lag",
    "warm_up": "100 s of motion, the gyro's bias drifting by 0.3 deg/s (60 s) as it warms up",
    "untrimmed": "no lag; the gyro's sensitivity within 3 % (two sigma), as its data sheet has it",
    "analog": "both sensors on the board's own analog inputs, 12 bits, sampled in every step",
}
SECONDS = {name: 110.0 if name == "warm_up" else 30.0 for name in SCENARIOS}
DEFAULT_SCENARIO, DEFAULT_TUNING = "motion", "data"
CONDITIONS = {
    "lag_s": "the gyro's lag, s",
    "spike_share": "share of samples that are spikes",
    "gyro_scale": "standard deviation of the gyro's scale error",
    "angular_scale": "standard deviation of the angular accelerometer's scale error",
}
FAULTS = {
    "lost": "a sensor, gyro or angular, gives no samples, for example lost:gyro@15-20",
    "railed": "a sensor at its rail",
    "stuck": "a sensor that repeats its last sample",
}
FAULT_CHANNELS = {"gyro": slice(0, 3), "angular": slice(3, 6)}

GYRO = Channel(0.0, 1.0 / GYRO_LSB_PER_DPS, 1 - COUNT_MAX, COUNT_MAX - 1)
ANGULAR = Channel(0.0, 1.0 / ANGULAR_LSB_PER_DPS2, 1 - COUNT_MAX, COUNT_MAX - 1)
GYRO_ADC = Channel(ADC_COUNTS / 2.0, 1.0 / ADC_LSB_PER_DPS, 1, ADC_COUNTS - 2)
ANGULAR_ADC = Channel(ADC_COUNTS / 2.0, 1.0 / ADC_LSB_PER_DPS2, 1, ADC_COUNTS - 2)

DATA = TurntableTuning(
    period_us=PERIOD_US,
    gyro=GYRO,
    angular=ANGULAR,
    gyro_filter=Prefilter(spike=4.0),
    angular_filter=Prefilter(spike=60.0),
    fusion=Fusion(),
)
"""The densities are those of the scenario; the spike limits follow from the noise of a line through two samples."""


def with_fusion(tuning: TurntableTuning, **changes: object) -> TurntableTuning:
    """The tuning with other settings of its filter."""
    return replace(tuning, fusion=replace(tuning.fusion, **changes))  # type: ignore[arg-type]


KNOWN = with_fusion(DATA, gyro_scale=0.0, angular_scale=0.0, start_lag_s=0.0)
TUNINGS = {
    "data": DATA,
    "attitude": with_fusion(DATA, layer="attitude"),
    "known": KNOWN,
    "printed": with_fusion(KNOWN, layer="printed"),
    "printed_lagging": with_fusion(KNOWN, layer="printed", lag_s=0.0),
    "short_lag": with_fusion(DATA, lag_s=0.7 * 0.008),
    "short_lag_known": with_fusion(KNOWN, lag_s=0.7 * 0.008),
    "no_lag": with_fusion(DATA, lag_s=0.0, start_lag_s=0.0),
    "no_lag_attitude": with_fusion(DATA, layer="attitude", lag_s=0.0, start_lag_s=0.0),
    "warm_up": with_fusion(DATA, gyro_walk_dps=0.02),
    "untrimmed": with_fusion(DATA, lag_s=0.0, start_lag_s=0.0, gyro_scale=0.015),
    "loose_angular": with_fusion(DATA, angular_scale=0.03),
    "smoothed": replace(DATA, gyro_filter=Prefilter(4.0, 0.75), angular_filter=Prefilter(60.0, 0.75)),
    "analog": replace(with_fusion(DATA, gyro_period_s=PERIOD_US * 1e-6), gyro=GYRO_ADC, angular=ANGULAR_ADC),
}
TUNING_NOTES = {
    "data": "data layer, the angle a state; difference in scale and lag estimated",
    "attitude": "attitude layer, both attitudes corrected by their difference",
    "known": "data layer, scale and lag taken as they are set",
    "printed": "data layer as printed: the corrected rate alone turns the quaternion; the known lag undone",
    "printed_lagging": "data layer as printed, the lag not undone",
    "short_lag": "data, starting from a lag 30 % too short",
    "short_lag_known": "known, with a lag 30 % too short",
    "no_lag": "data, for a gyro without lag",
    "no_lag_attitude": "attitude, for a gyro without lag",
    "warm_up": "data, for a gyro bias that walks by 0.02 deg/s/sqrt(s)",
    "untrimmed": "data, for a gyro without lag and with 1.5 % of scale error",
    "loose_angular": "data, for an angular accelerometer whose scale may be 3 % wrong; the one to take when in doubt",
    "smoothed": "data, behind a one-pole low-pass for each sensor",
    "analog": "data, for both sensors on the board's own converter, the gyro sampled in every step",
}


@dataclass(frozen=True)
class Outage:
    """Fault of a sensor: no samples, or wrong ones, for some time."""

    kind: str
    sensor: str
    start_s: float
    stop_s: float


def faults(requests: Sequence[Request]) -> tuple[Outage, ...]:
    """Outages for `scenario`; raises UsageError for an unknown kind or sensor."""
    for asked in requests:
        if asked.kind not in FAULTS or asked.what not in FAULT_CHANNELS:
            kinds, sensors = ", ".join(FAULTS), " or ".join(FAULT_CHANNELS)
            raise UsageError(f"turntable has no fault '{asked.kind}:{asked.what}'; it has {kinds} of {sensors}")
    return tuple(Outage(asked.kind, asked.what, asked.start_s, asked.stop_s) for asked in requests)


@dataclass(frozen=True)
class Scenario:
    """One run: truth and samples. attitude: (steps, 4), rate_dps: (steps, 3) at the steps; gyro_s: (samples,) instants
    of the gyro, gyro_attitude: (samples, 4) truth there; gyro, gyro_clean: (samples, 3) counts, with and without
    spikes; angular: (steps, 3) counts."""

    name: str
    seed: int
    period_us: int
    attitude: FloatArray
    rate_dps: FloatArray
    gyro_s: FloatArray
    gyro_attitude: FloatArray
    gyro: npt.NDArray[np.int16]
    gyro_clean: npt.NDArray[np.int16]
    angular: npt.NDArray[np.int16]
    outages: tuple[Outage, ...] = field(default=())

    @property
    def steps(self) -> int:
        return len(self.attitude)

    @property
    def time_s(self) -> FloatArray:
        return np.arange(self.steps, dtype=np.float64) * (self.period_us * 1e-6)

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """True for the samples of the motion, (steps,)."""
        return np.asarray(self.time_s >= REST_S)

    @property
    def gyro_step(self) -> npt.NDArray[np.int_]:
        """The step that uses each gyro sample: the first step at or after it."""
        return np.ceil(self.gyro_s / (self.period_us * 1e-6) - 1e-9).astype(np.int_)

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts, (steps, 6)."""
        raw = np.full((self.steps, 6), NO_SAMPLE, np.int16)
        raw[self.gyro_step, :3] = self.gyro
        raw[:, 3:] = self.angular
        rail = ADC_COUNTS - 1 if self.name == "analog" else COUNT_MAX
        for outage in self.outages:
            during = np.flatnonzero((self.time_s >= outage.start_s) & (self.time_s < outage.stop_s))
            sensor = FAULT_CHANNELS[outage.sensor]
            sampled = during[raw[during, sensor.start] != NO_SAMPLE]
            if outage.kind == "stuck" and len(sampled):
                raw[sampled, sensor] = raw[sampled[0], sensor]
            else:
                raw[sampled, sensor] = NO_SAMPLE if outage.kind == "lost" else rail
        return raw

    def setpoint(self) -> npt.NDArray[np.int32]:
        return np.zeros(self.steps, np.int32)

    def truth(self) -> dict[str, FloatArray]:
        attitude = {f"attitude_{axis}": self.attitude[:, i] for i, axis in enumerate("wxyz")}
        return {**attitude, **{f"rate_dps_{i}": self.rate_dps[:, i] for i in range(3)}}

    def fit(self, tuning: TurntableTuning) -> TurntableTuning:
        """The tuning with this run's sampling phase of the gyro."""
        return with_fusion(tuning, gyro_phase_s=float(self.gyro_s[0]))


def scenario(
    name: str,
    seed: int,
    *,
    seconds: float | None = None,
    period_us: int = PERIOD_US,
    faults: tuple[Outage, ...] = (),
    **conditions: float,
) -> Scenario:
    """Draw a run. One generator per seed, in this order:

    slow frequencies and amplitudes, quick ones (3 each), phase of the gyro, biases (3, 3), signs of the warm-up (3),
    scales (3, 3), walks of gyro and angular accelerometer, their noise, their spikes and the spikes' signs. A scenario
    that does not use a value draws it nevertheless, so that seeds are comparable.
    """
    seconds = length_s("turntable", name, SECONDS, seconds, period_us, (500, 10_000), seed)
    errors, dt = replace(ERRORS[name], **conditions), period_us * 1e-6
    if max(errors.spike_share, errors.lag_s, errors.gyro_scale, errors.angular_scale) > 1.0:
        raise UsageError("spike_share, gyro_scale, angular_scale and lag_s are 1 at most")
    rng, steps = np.random.default_rng(seed), round(seconds / dt)
    slow_hz, slow_deg = rng.uniform(*SLOW_HZ, 3), rng.uniform(*SLOW_DEG, 3)
    quick_hz, quick_deg = rng.uniform(*QUICK_HZ, 3), rng.uniform(*QUICK_DEG, 3)
    phase_s, gyro_period_s = float(rng.uniform(0.0, GYRO_PERIOD_S)), GYRO_PERIOD_S
    if name == "analog":
        phase_s, gyro_period_s = 0.0, dt
    samples = int(((steps - 1) * dt - phase_s) / gyro_period_s + 1e-9) + 1
    gyro_s = np.asarray(phase_s + np.arange(samples) * gyro_period_s, np.float64)
    bias_dps = errors.bias * rng.uniform(-GYRO_BIAS_DPS, GYRO_BIAS_DPS, 3)
    bias_dps2 = errors.bias * rng.uniform(-ANGULAR_BIAS_DPS2, ANGULAR_BIAS_DPS2, 3)
    warm_up = errors.warm_up_dps * rng.choice([-1.0, 1.0], 3)
    gyro_scale = 1.0 + errors.gyro_scale * rng.standard_normal(3)
    angular_scale = 1.0 + errors.angular_scale * rng.standard_normal(3)

    def walk(density: float, period_s: float, count: int) -> FloatArray:
        return np.cumsum(density * np.sqrt(period_s) * rng.standard_normal((count, 3)), axis=0)

    gyro_walk = walk(errors.walk_dps, gyro_period_s, len(gyro_s))
    angular_walk = walk(errors.walk_dps2, dt, steps)
    gyro_sigma, angular_sigma = errors.gyro_dps / np.sqrt(gyro_period_s), errors.angular_dps2 / np.sqrt(dt)
    gyro_noise = gyro_sigma * rng.standard_normal((len(gyro_s), 3))
    angular_noise = angular_sigma * rng.standard_normal((steps, 3))
    spikes = []
    for shape, sigma in ((gyro_noise.shape, gyro_sigma), (angular_noise.shape, angular_sigma)):
        hit = rng.random(shape) < errors.spike_share
        spikes.append(hit * SPIKE_SIGMA * sigma * rng.choice([-1.0, 1.0], shape))

    grid_s: FloatArray = np.arange((steps - 1) * SUBSTEPS + 1, dtype=np.float64) * (dt / SUBSTEPS)
    attitude, rate_dps = motion(grid_s, (slow_hz, slow_deg), (quick_hz, quick_deg))
    acceleration_dps2 = np.asarray(np.gradient(rate_dps, dt / SUBSTEPS, axis=0))[::SUBSTEPS]
    drift = warm_up * (1.0 - np.exp(-gyro_s[:, None] / WARM_UP_TAU_S))
    gyro_dps = gyro_scale * at(gyro_s, grid_s, lagged(rate_dps, errors.lag_s, dt / SUBSTEPS))
    gyro_dps = gyro_dps + bias_dps + gyro_walk + drift + gyro_noise
    angular_dps2 = angular_scale * acceleration_dps2 + bias_dps2 + angular_walk + angular_noise
    at_gyro = at(gyro_s, grid_s, attitude)
    gyro, angular = (GYRO_ADC, ANGULAR_ADC) if name == "analog" else (GYRO, ANGULAR)
    return Scenario(
        name,
        seed,
        period_us,
        attitude[::SUBSTEPS],
        rate_dps[::SUBSTEPS],
        gyro_s,
        at_gyro / np.linalg.norm(at_gyro, axis=1, keepdims=True),
        counts_of(gyro_dps + spikes[0], gyro),
        counts_of(gyro_dps, gyro),
        counts_of(angular_dps2 + spikes[1], angular),
        faults,
    )


def counts_of(value: FloatArray, channel: Channel) -> npt.NDArray[np.int16]:
    """Counts of a sensor on this channel; a value beyond the range becomes the rail, one count outside the range."""
    counts = np.rint(value / channel.unit_per_count + channel.zero_counts)
    return np.clip(counts, channel.min_counts - 1, channel.max_counts + 1).astype(np.int16)


class TurntablePlant:
    """Plays the prescribed samples of a run; the outputs have no effect. name: of the scenario."""

    def __init__(self, run: Scenario) -> None:
        self.name, self.period_us = run.name, run.period_us
        self._period_s, self._counts, self._truth = run.period_us * 1e-6, run.counts(), run.truth()

    def _step(self, time_s: float) -> int:
        return min(round(time_s / self._period_s), len(self._counts) - 1)

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """The motion is prescribed."""

    def counts(self, time_s: float) -> tuple[int, ...]:
        return tuple(int(count) for count in self._counts[self._step(time_s)])

    def truth(self, time_s: float) -> dict[str, float]:
        step = self._step(time_s)
        return {name: float(values[step]) for name, values in self._truth.items()}

    def setpoint(self, time_s: float) -> int:
        return 0


def plant(run: Scenario, open_loop: bool = False) -> TurntablePlant:
    """The plant of a run, which plays its samples."""
    return TurntablePlant(run)

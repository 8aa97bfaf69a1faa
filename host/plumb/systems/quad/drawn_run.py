"""One run of `quad` with all its random values, and what the sensors make of its motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from plumb.physics.sensors import Enc03, Fault, Mma7260, OnePole, Push, adc_counts
from plumb.spec.arrays import FloatArray
from plumb.systems import scoring
from plumb.systems.quad.lateral import GRID_S, Lateral

CHANNELS = 3
GYRO = Enc03()


@dataclass(frozen=True, eq=False)
class Prescribed:
    """What all runs of a scenario share, on the grid, (points + 1,) each: tilt_deg; setpoint_deg, of a closed loop, in
    `motion` and `quiet` the prescribed motion; hand: when the hand holds the axis in a closed loop."""

    tilt_deg: FloatArray
    setpoint_deg: FloatArray
    hand: npt.NDArray[np.bool_]

    @cached_property
    def rate_dps(self) -> FloatArray:
        return np.asarray(np.gradient(self.tilt_deg, GRID_S), np.float64)


@dataclass(frozen=True)
class Sampled:
    """A prescribed motion at the sampling instants, (steps,) each; gravity behind the accelerometer's low-pass."""

    time_s: FloatArray
    tilt_deg: FloatArray
    rate_dps: FloatArray
    gravity_y_g: FloatArray
    gravity_z_g: FloatArray
    setpoint: npt.NDArray[np.int32]
    scored: npt.NDArray[np.bool_]


@lru_cache(maxsize=16)
def _sampled(motion: Prescribed, steps: int, period_us: int, bandwidth_hz: float) -> Sampled:
    time_s, tilt_rad = np.arange(steps, dtype=np.float64) * (period_us * 1e-6), np.radians(motion.tilt_deg)
    pole = OnePole.of(bandwidth_hz, GRID_S)
    nearest = np.minimum(np.rint(time_s / GRID_S).astype(np.int64), len(motion.setpoint_deg) - 1)
    found = Sampled(
        time_s,
        on_grid(motion.tilt_deg, time_s),
        on_grid(motion.rate_dps, time_s),
        on_grid(pole.run(np.sin(tilt_rad)), time_s),
        on_grid(pole.run(np.cos(tilt_rad)), time_s),
        np.rint(motion.setpoint_deg[nearest] / 360.0 * 2.0**32).astype(np.int64).astype(np.int32),
        scoring.scored(time_s),
    )
    for shared in vars(found).values():
        shared.flags.writeable = False
    return found


def on_grid(grid: FloatArray, time_s: npt.ArrayLike) -> FloatArray:
    """A grid array at any times: linear interpolation, constant beyond the ends."""
    points = np.interp(np.asarray(time_s, np.float64) / GRID_S, np.arange(len(grid)), grid)
    return np.asarray(points, np.float64)


class LateNoise:
    """The noise that is drawn last, when a run needs it: a prescribed motion has no torque, most runs no fault.

    It keeps the state of the generator, not the generator, so that a restored snapshot draws the same again.
    """

    def __init__(self, rng: np.random.Generator, points: int, steps: int) -> None:
        self._kind, self._state = type(rng.bit_generator), rng.bit_generator.state
        self._points, self._steps = points, steps

    @cached_property
    def drawn(self) -> tuple[FloatArray, FloatArray]:
        """Of the torque, (1 + points,), and of faults, (3, steps)."""
        bits = self._kind()
        bits.state = self._state
        rng = np.random.Generator(bits)
        return rng.standard_normal(1 + self._points), rng.standard_normal((CHANNELS, self._steps))


@dataclass(frozen=True)
class Scenario:
    """One run: its motion and all its random values. Grid arrays have one value per GRID_S, sample arrays one per
    period.

    The axis follows the prescribed motion while its hand holds it, and always in open loop. Samples: bias_dps,
    gyro_noise_dps: (steps,); accel_noise_g: (2, steps); adc_noise_v: (3, steps). delay_s: how much later the pulses
    reach the motors.
    """

    name: str
    seed: int
    period_us: int
    accelerometer: Mma7260
    prescribed: Prescribed
    lateral: Lateral
    scale: float
    offset_g: FloatArray
    bias_dps: FloatArray
    gyro_noise_dps: FloatArray
    accel_noise_g: FloatArray
    adc_noise_v: FloatArray
    late_noise: LateNoise
    faults: tuple[Fault, ...] = ()
    pushes: tuple[Push, ...] = ()
    delay_s: float = 0.0

    @property
    def steps(self) -> int:
        return len(self.bias_dps)

    @property
    def prescribed_deg(self) -> FloatArray:
        """The prescribed tilt, on the grid."""
        return self.prescribed.tilt_deg

    @property
    def setpoint_deg(self) -> FloatArray:
        """The setpoint of a closed loop, on the grid."""
        return self.prescribed.setpoint_deg

    @property
    def hand(self) -> npt.NDArray[np.bool_]:
        """When the hand holds the axis in a closed loop, on the grid."""
        return self.prescribed.hand

    @property
    def lateral_g(self) -> FloatArray:
        """Lateral acceleration, on the grid."""
        return self.lateral.on_grid

    @property
    def torque_noise(self) -> FloatArray:
        """Imbalance, then gusts, on the grid; unit white noise."""
        return self.late_noise.drawn[0]

    @property
    def fault_noise(self) -> FloatArray:
        """Unit white noise, (3, steps)."""
        return self.late_noise.drawn[1]

    @property
    def _sampled(self) -> Sampled:
        return _sampled(self.prescribed, self.steps, self.period_us, self.accelerometer.bandwidth_hz)

    @property
    def time_s(self) -> FloatArray:
        """Sampling instants, (steps,)."""
        return self._sampled.time_s

    def tilt_deg(self) -> FloatArray:
        """True tilt of the prescribed motion at the sampling instants, (steps,)."""
        return self._sampled.tilt_deg

    def truth(self) -> dict[str, FloatArray]:
        """True values of the estimated quantities for the prescribed motion, (steps,) each."""
        return {"tilt_deg": self.tilt_deg(), "bias_dps": self.bias_dps}

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """The samples that count, (steps,)."""
        return self._sampled.scored

    def rate_dps(self) -> FloatArray:
        """True rate of the prescribed motion at the sampling instants, (steps,)."""
        return self._sampled.rate_dps

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Setpoints of a closed loop, turn_q32, (steps,)."""
        return self._sampled.setpoint

    def volts(self) -> FloatArray:
        """Pin volts of the prescribed motion at the sampling instants, (steps, 3)."""
        motion, whole = self._sampled, slice(None)
        clean = self.sensed(whole, motion.rate_dps, motion.gravity_y_g + self._lateral_g(), motion.gravity_z_g)
        return self.faulted(clean, np.arange(self.steps), motion.time_s, {}) if self.faults else clean

    def _lateral_g(self) -> FloatArray:
        """Lateral acceleration behind the low-pass at the sampling instants, (steps,)."""
        pole, stride = OnePole.of(self.accelerometer.bandwidth_hz, GRID_S), round(self.period_us * 1e-6 / GRID_S)
        found = None
        if stride >= 1 and abs(self.period_us * 1e-6 - stride * GRID_S) < 1e-12:
            found = self.lateral.low_passed(pole, stride)
        if found is None or len(found) != self.steps:
            found = on_grid(pole.run(self.lateral.on_grid), self.time_s)
        return found

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of the prescribed motion, (steps, 6): three channels, then zeros."""
        raw = np.zeros((self.steps, 6), np.int16)
        raw[:, :CHANNELS] = adc_counts(self.volts())
        return raw

    def sensed(
        self, k: npt.NDArray[np.int_] | slice, rate_dps: FloatArray, accel_y_g: FloatArray, accel_z_g: FloatArray
    ) -> FloatArray:
        """Pin voltages (n, 3) from true rate and filtered force, (n,) each, with the sensor errors and noise of the
        samples k."""
        volts = np.empty((len(rate_dps), CHANNELS))
        rate_dps = self.scale * rate_dps + self.bias_dps[k] + self.gyro_noise_dps[k]
        volts[:, 0] = GYRO.volts(rate_dps) + self.adc_noise_v[0, k]
        for place, true_g in enumerate((accel_y_g, accel_z_g)):
            force_g = true_g + self.accel_noise_g[place, k] + self.offset_g[place]
            volts[:, 1 + place] = self.accelerometer.volts(force_g) + self.adc_noise_v[1 + place, k]
        return volts

    def faulted(
        self, volts: FloatArray, k: npt.NDArray[np.int_], time_s: FloatArray, frozen: dict[Fault, float]
    ) -> FloatArray:
        """The voltages (n, 3) with this run's faults applied; frozen holds the last value of a stuck channel."""
        for fault in self.faults:
            begun = np.flatnonzero(time_s >= fault.start_s)
            if len(begun) and fault not in frozen:
                frozen[fault] = float(volts[begun[0], fault.channel])
            channel = volts[:, fault.channel]
            noise = self.fault_noise[fault.channel, k]
            volts[:, fault.channel] = fault.volts(channel, time_s, frozen.get(fault, 0.0), noise)
        return volts

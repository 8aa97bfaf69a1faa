"""One run of `quad` with all its random values, and what the sensors make of its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.physics.sensors import Enc03, Fault, Mma7260, OnePole, Push, adc_counts
from plumb.spec.arrays import FloatArray
from plumb.systems import scoring

CHANNELS = 3
GRID_S = 0.001
"""Step of the simulated physics, and of signals that are filtered before they are sampled."""
GYRO = Enc03()


@dataclass(frozen=True)
class Scenario:
    """One run: its motion and all its random values. Grid arrays have one value per GRID_S, sample arrays one per
    period.

    Grid: prescribed_deg, setpoint_deg, lateral_g, hand. The axis follows prescribed_deg while `hand` is true, and
    always in open loop. setpoint_deg is the setpoint of a closed loop; in `motion` and `quiet` it is the prescribed
    motion. Samples: bias_dps, gyro_noise_dps: (steps,); accel_noise_g: (2, steps); adc_noise_v, fault_noise: (3,
    steps). delay_s: how much later the pulses reach the motors.
    """

    name: str
    seed: int
    period_us: int
    accelerometer: Mma7260
    prescribed_deg: FloatArray
    setpoint_deg: FloatArray
    lateral_g: FloatArray
    hand: npt.NDArray[np.bool_]
    scale: float
    offset_g: FloatArray
    bias_dps: FloatArray
    gyro_noise_dps: FloatArray
    accel_noise_g: FloatArray
    adc_noise_v: FloatArray
    fault_noise: FloatArray
    torque_noise: FloatArray
    faults: tuple[Fault, ...] = ()
    pushes: tuple[Push, ...] = ()
    delay_s: float = 0.0

    @property
    def steps(self) -> int:
        return len(self.bias_dps)

    @property
    def time_s(self) -> FloatArray:
        """Sampling instants, (steps,)."""
        return np.arange(self.steps, dtype=np.float64) * (self.period_us * 1e-6)

    def on_grid(self, grid: FloatArray, time_s: npt.ArrayLike) -> FloatArray:
        """A grid array at any times: linear interpolation, constant beyond the ends."""
        points = np.interp(np.asarray(time_s, np.float64) / GRID_S, np.arange(len(grid)), grid)
        return np.asarray(points, np.float64)

    def tilt_deg(self) -> FloatArray:
        """True tilt of the prescribed motion at the sampling instants, (steps,)."""
        return self.on_grid(self.prescribed_deg, self.time_s)

    def truth(self) -> dict[str, FloatArray]:
        """True values of the estimated quantities for the prescribed motion, (steps,) each."""
        return {"tilt_deg": self.tilt_deg(), "bias_dps": self.bias_dps}

    @property
    def scored(self) -> npt.NDArray[np.bool_]:
        """The samples that count, (steps,)."""
        return scoring.scored(self.time_s)

    def rate_dps(self) -> FloatArray:
        """True rate of the prescribed motion at the sampling instants, (steps,)."""
        return self.on_grid(np.asarray(np.gradient(self.prescribed_deg, GRID_S), np.float64), self.time_s)

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Setpoints of a closed loop, turn_q32, (steps,)."""
        nearest = np.minimum(np.rint(self.time_s / GRID_S).astype(np.int64), len(self.setpoint_deg) - 1)
        return np.rint(self.setpoint_deg[nearest] / 360.0 * 2.0**32).astype(np.int64).astype(np.int32)

    def volts(self) -> FloatArray:
        """Pin volts of the prescribed motion at the sampling instants, (steps, 3)."""
        tilt_rad = np.radians(self.prescribed_deg)
        low_pass = OnePole.of(self.accelerometer.bandwidth_hz, GRID_S)
        accel_y_g = low_pass.run(np.sin(tilt_rad) + self.lateral_g)
        accel_z_g = low_pass.run(np.cos(tilt_rad))
        t, k = self.time_s, np.arange(self.steps)
        clean = self.sensed(k, self.rate_dps(), self.on_grid(accel_y_g, t), self.on_grid(accel_z_g, t))
        return self.faulted(clean, k, t, {})

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of the prescribed motion, (steps, 6): three channels, then zeros."""
        raw = np.zeros((self.steps, 6), np.int16)
        raw[:, :CHANNELS] = adc_counts(self.volts())
        return raw

    def sensed(
        self, k: npt.NDArray[np.int_], rate_dps: FloatArray, accel_y_g: FloatArray, accel_z_g: FloatArray
    ) -> FloatArray:
        """Pin voltages (n, 3) from true rate and filtered force, (n,) each, with the sensor errors and noise of sample
        k."""
        force_g = np.stack([accel_y_g, accel_z_g]) + self.accel_noise_g[:, k] + self.offset_g[:, None]
        gyro_v = GYRO.volts(self.scale * rate_dps + self.bias_dps[k] + self.gyro_noise_dps[k])
        return (np.vstack([gyro_v, self.accelerometer.volts(force_g)]) + self.adc_noise_v[:, k]).T

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

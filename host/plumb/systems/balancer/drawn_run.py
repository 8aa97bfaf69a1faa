"""One run of `balancer` with all its random values, and what the sensors make of its motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.physics.sensors import Adxl345, Fault, Itg3205
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer.vehicle import GRID_S
from plumb.systems.prescribed import Steps

CHANNELS = 4
GYRO, ACCELEROMETER = Itg3205(), Adxl345()
DPS_PER_G = 0.1
"""Sensitivity of the gyro to acceleration, deg/s per g."""
VELOCITY_UNIT = 1 << 26
"""Setpoints are m/s Q26."""


@dataclass(frozen=True)
class Ride:
    """True motion at the sampling instants, (steps,) each: deg, deg/s, m/s, Hall edges; force_g: (2, steps)."""

    tilt_deg: FloatArray
    rate_dps: FloatArray
    velocity_mps: FloatArray
    force_g: FloatArray
    edges: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Scenario(Steps):
    """One run: its commands, pushes and all its random values. Grid arrays have one value per GRID_S, sample arrays one
    per period.

    Grid: hand_rad, held: tilt that the hand forces, and when; command_mps: velocity setpoint; push_mps2: pushes as the
    equivalent acceleration of the axle; disturbance: unit white noise, zero before 5 s.
    Samples: vibration_g, accel_noise_lsb: (2, steps); bias_dps, gyro_noise_dps: (steps,); fault_noise: (4, steps).
    prescribed: gives the motion of the ideal controller; runs that differ in their sensors alone share it.
    """

    name: str
    seed: int
    period_us: int
    hand_rad: FloatArray
    held: npt.NDArray[np.bool_]
    command_mps: FloatArray
    push_mps2: FloatArray
    disturbance: FloatArray
    scale: float
    offset_g: FloatArray
    bias_dps: FloatArray
    vibration_g: FloatArray
    accel_noise_lsb: FloatArray
    gyro_noise_dps: FloatArray
    fault_noise: FloatArray
    prescribed: Callable[[], Ride]
    faults: tuple[Fault, ...] = ()

    @property
    def steps(self) -> int:
        return len(self.bias_dps)

    @property
    def ride(self) -> Ride:
        """The prescribed motion: that of the ideal controller under the commands and pushes."""
        return self.prescribed()

    def truth(self) -> dict[str, FloatArray]:
        """True values of the estimated quantities for the prescribed motion, (steps,) each."""
        ride = self.ride
        return {
            "tilt_deg": ride.tilt_deg,
            "bias_dps": self.bias_dps,
            "rate_dps": ride.rate_dps,
            "velocity_mps": ride.velocity_mps,
        }

    def setpoint(self) -> npt.NDArray[np.int32]:
        """Velocity setpoints, m/s Q26, (steps,)."""
        at = np.minimum(np.rint(self.time_s / GRID_S).astype(np.int64), len(self.command_mps) - 1)
        return np.rint(self.command_mps[at] * VELOCITY_UNIT).astype(np.int32)

    def counts(self) -> npt.NDArray[np.int16]:
        """Raw counts of the prescribed motion, (steps, 6): four channels, then zeros."""
        k, ride = np.arange(self.steps), self.ride
        return self.faulted(self.sensed(k, ride.rate_dps, ride.force_g, ride.edges), k, self.time_s, {})

    def sensed(
        self, k: npt.NDArray[np.int_], rate_dps: FloatArray, force_g: FloatArray, edges: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int16]:
        """Counts (n, 6) of samples k at true rate and force (2, n)."""
        gyro_dps, accel_g = self.felt(k, rate_dps, force_g)
        raw = np.zeros((len(k), 6), np.int16)
        raw[:, 0], raw[:, 1:3] = GYRO.counts(gyro_dps), ACCELEROMETER.counts(accel_g).T
        raw[:, 3] = edges.astype(np.int16)
        return raw

    def felt(self, k: npt.NDArray[np.int_], rate_dps: FloatArray, force_g: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Inputs of the chips in samples k: true rate and force plus vibration, sensor errors and noise; deg/s (n,) and
        g (2, n)."""
        shaken_g = force_g + self.vibration_g[:, k]
        gyro_dps = self.scale * rate_dps + self.bias_dps[k] + DPS_PER_G * shaken_g[0] + self.gyro_noise_dps[k]
        return gyro_dps, shaken_g + self.offset_g[:, None] + ACCELEROMETER.g_per_lsb * self.accel_noise_lsb[:, k]

    def faulted(
        self, raw: npt.NDArray[np.int16], k: npt.NDArray[np.int_], time_s: FloatArray, frozen: dict[int, int]
    ) -> npt.NDArray[np.int16]:
        """The counts (n, 6) with this run's faults applied; frozen holds the last value of a stuck channel."""
        for number, fault in enumerate(self.faults):
            begun = np.flatnonzero(time_s >= fault.start_s)
            if len(begun) and number not in frozen:
                frozen[number] = int(raw[begun[0], fault.channel])
            noise = self.fault_noise[fault.channel, k]
            raw[:, fault.channel] = fault.counts(raw[:, fault.channel], time_s, frozen.get(number, 0), noise)
        return raw

"""The prescribed rides of a scenario over many seeds, stacked, and the tilt that each sensor alone gives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.proof import metrics
from plumb.spec.arrays import FloatArray
from plumb.systems.balancer import scenarios as balancer


@dataclass(frozen=True)
class Batch:
    """One scenario's prescribed rides: raw (steps, 6, runs), setpoint, tilt and rate (steps, runs)."""

    name: str
    raw: npt.NDArray[np.int16]
    setpoint: npt.NDArray[np.int32]
    tilt_deg: FloatArray
    rate_dps: FloatArray
    scored: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, name: str, seeds: Iterable[int]) -> Batch:
        runs = [balancer.scenario(name, seed) for seed in seeds]
        return cls(
            name,
            np.stack([run.counts() for run in runs], axis=-1),
            np.stack([run.setpoint() for run in runs], axis=-1),
            np.stack([run.ride.tilt_deg for run in runs], axis=-1),
            np.stack([run.ride.rate_dps for run in runs], axis=-1),
            runs[0].scored,
        )

    def tilt_rms(self, tilt_deg: FloatArray) -> FloatArray:
        """Rms of the error of the tilt in every run, (runs,)."""
        return metrics.angle_rmse_deg(tilt_deg, self.tilt_deg, self.scored)

    def rate_rms(self, rate_dps: FloatArray) -> FloatArray:
        """Rms of the error of the rate in every run, (runs,)."""
        return np.asarray(np.sqrt(np.mean((rate_dps - self.rate_dps)[self.scored] ** 2, axis=0)), np.float64)

    def gyro_dps(self) -> FloatArray:
        return np.asarray(self.raw[:, 0] * balancer.CALIBRATION.gyro.unit_per_count, np.float64)

    def accel_only_deg(self) -> FloatArray:
        return metrics.accel_only_deg(-self.raw[:, 1].astype(np.float64), self.raw[:, 2].astype(np.float64))

    def gyro_only_deg(self) -> FloatArray:
        return metrics.gyro_only_deg(self.gyro_dps(), balancer.PERIOD_US * 1e-6, self.tilt_deg[:1])

"""Innovations of the Kalman filter of tilt and bias, and how consistent they are with the filter's own variances.

A filter whose Q and R describe the recording has innovations that are white, with the variance S that the filter itself
states. Their likelihood says how well a set of Q and R describes the recording:

    -2 log L = sum over the steps of log S + innovation^2 / S + log 2 pi
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plumb.spec.arrays import FloatArray

SETTLE_S = 2.0
"""Beginning of a recording that does not count: the filter learns its start."""
LAGS = 40
NIS_95 = 3.841
"""95 % of the normalised innovations squared are below, by the filter's model: the quantile of chi-squared."""
START_BIAS_DPS2 = 25.0


@dataclass(frozen=True)
class Variances:
    """Q as densities, and R at 1 g: the settings of a filter that a recording can show."""

    q_angle_deg2_per_s: float
    q_bias_dps2_per_s: float
    r_deg2: float


@dataclass(frozen=True)
class Measured:
    """Inputs of the filter, (steps,) each: z_deg, the tilt of the accelerometer; rate_dps of the gyro, as it drives the
    prediction of the step; growth_deg2, what the deviation of |a| from 1 g adds to R, up to r_max_deg2."""

    period_s: float
    z_deg: FloatArray
    rate_dps: FloatArray
    growth_deg2: FloatArray
    r_max_deg2: float

    @property
    def settled(self) -> int:
        """First step that counts."""
        return min(round(SETTLE_S / self.period_s), len(self.z_deg) // 2)

    def r_deg2(self, variances: Variances) -> FloatArray:
        """R of every step, as plumb.kernels.reference.kernels.trust."""
        return np.minimum(variances.r_deg2 + self.growth_deg2, max(self.r_max_deg2, variances.r_deg2))


@dataclass(frozen=True)
class Innovations:
    """Results for the steps that count, (n,): innovation_deg and its variance s_deg2. tilt_deg: the estimate, of every
    step."""

    innovation_deg: FloatArray
    s_deg2: FloatArray
    tilt_deg: FloatArray

    @cached_property
    def normalised(self) -> FloatArray:
        """Innovations in their own standard deviations."""
        return np.asarray(self.innovation_deg / np.sqrt(self.s_deg2))

    @property
    def loss(self) -> float:
        """-log L."""
        squared = self.normalised * self.normalised
        return 0.5 * float(np.sum(np.log(2.0 * math.pi * self.s_deg2) + squared))

    @property
    def mean_nis(self) -> float:
        """Mean of the normalised innovation squared; 1 where the variances are right."""
        return float(np.mean(self.normalised**2))

    @property
    def inside(self) -> float:
        """Share of the innovations within the filter's 95 %."""
        return float(np.mean(self.normalised**2 <= NIS_95))

    @cached_property
    def autocorrelation(self) -> FloatArray:
        """Autocorrelation of the normalised innovations at lags 1 to LAGS."""
        centred = self.normalised - np.mean(self.normalised)
        power = float(centred @ centred) or 1.0
        return np.array([float(centred[lag:] @ centred[:-lag]) / power for lag in range(1, LAGS + 1)])

    @property
    def white_within(self) -> float:
        """Bound of the autocorrelation that 95 % of the lags of white innovations keep."""
        return 1.96 / math.sqrt(len(self.normalised))

    @property
    def whiteness(self) -> float:
        """Ljung-Box test over all lags: the chance that white innovations are as correlated as these."""
        from scipy.stats import chi2

        n = len(self.normalised)
        lags = np.arange(1, LAGS + 1)
        statistic = n * (n + 2) * float(np.sum(self.autocorrelation**2 / (n - lags)))
        return float(chi2.sf(statistic, LAGS))


def innovations(measured: Measured, variances: Variances) -> Innovations:
    """Run equations (1) to (5) of plumb.kernels.reference.kernels over the recording, which begins at the first
    measured tilt without bias."""
    ts = measured.period_s
    q_angle, q_bias = variances.q_angle_deg2_per_s * ts, variances.q_bias_dps2_per_s * ts
    r_series = measured.r_deg2(variances)
    tilt, bias = float(measured.z_deg[0]), 0.0
    p00, p01, p11 = float(r_series[0]), 0.0, START_BIAS_DPS2
    found, stated, estimate = [], [], []
    for z, rate, r in zip(measured.z_deg.tolist(), measured.rate_dps.tolist(), r_series.tolist(), strict=True):
        tilt += ts * (rate - bias)
        p00 += q_angle - ts * (2.0 * p01 - ts * p11)
        p01 -= ts * p11
        p11 += q_bias
        s = p00 + r
        k0, k1 = p00 / s, p01 / s
        innovation = (z - tilt + 180.0) % 360.0 - 180.0
        tilt += k0 * innovation
        bias += k1 * innovation
        p11 -= k1 * p01
        p00 *= 1.0 - k0
        p01 *= 1.0 - k0
        found.append(innovation)
        stated.append(s)
        estimate.append(tilt)
    used = measured.settled
    return Innovations(np.array(found[used:]), np.array(stated[used:]), np.array(estimate))

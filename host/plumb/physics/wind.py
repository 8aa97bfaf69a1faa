"""Wind with turbulence: the Dryden spectra of MIL-F-8785C for low altitude, over many runs at once.

Along the mean wind the filter is of first order, across and vertically of second: sigma sqrt(L / (pi V))
(1 + sqrt(3) T s) / (1 + T s)^2 with T = L / V. V is the speed of the air past the body, here that of the mean wind.
"""

from __future__ import annotations

import numpy as np

from plumb.spec.arrays import FloatArray

FOOT_M = 0.3048
SPEED_MIN_MPS = 1.0


def lengths_m(altitude_m: float) -> tuple[float, float]:
    """Scale of turbulence along and across the wind, and of the vertical one."""
    feet = altitude_m / FOOT_M
    return FOOT_M * feet / (0.177 + 0.000823 * feet) ** 1.2, altitude_m


def sigmas_mps(altitude_m: float, wind_mps: float) -> tuple[float, float]:
    """Standard deviation of the horizontal and of the vertical gusts; wind_mps: at 20 feet."""
    vertical = 0.1 * wind_mps
    return vertical / (0.177 + 0.000823 * altitude_m / FOOT_M) ** 0.4, vertical


class Wind:
    """Mean wind with a direction of its own for each run, and gusts on request; velocity_mps(): earth axes, (3,
    runs). straight_mps, first_mps, second_mps: what the filters hold; scale_s: their times, (3, 1)."""

    def __init__(
        self, speed_mps: float, heading_rad: FloatArray, begin: FloatArray, altitude_m: float = 10.0, gusts: bool = True
    ) -> None:
        """begin: unit white noise for the gusts at the beginning, (5, runs)."""
        self.speed_mps = speed_mps
        self.along = np.stack([np.cos(heading_rad), np.sin(heading_rad)])
        horizontal, vertical = sigmas_mps(altitude_m, speed_mps if gusts else 0.0)
        long_m, high_m = lengths_m(altitude_m)
        past_mps = max(speed_mps, SPEED_MIN_MPS)
        self.scale_s = np.array([long_m, long_m, high_m])[:, None] / past_mps
        self.sigma_mps = np.array([horizontal, horizontal, vertical])[:, None]
        # First and second stage of the filters; the variance of their output is twice that of the first stage.
        first = self.sigma_mps[1:] / np.sqrt(2.0) * begin[1:3]
        self.first_mps, self.second_mps = first, first / 2.0 + self.sigma_mps[1:] / np.sqrt(8.0) * begin[3:5]
        self.straight_mps = self.sigma_mps[0] * begin[0]

    def advance(self, white: FloatArray, step_s: float) -> None:
        """white: unit noise, (3, runs)."""
        share = step_s / self.scale_s
        self.straight_mps += share[0] * -self.straight_mps + self.sigma_mps[0] * np.sqrt(2.0 * share[0]) * white[0]
        self.second_mps += share[1:] * (self.first_mps - self.second_mps)
        self.first_mps += share[1:] * -self.first_mps + self.sigma_mps[1:] * np.sqrt(share[1:]) * white[1:]

    def velocity_mps(self) -> FloatArray:
        along = self.speed_mps + self.straight_mps
        across, up = self.second_mps + np.sqrt(3.0) * (self.first_mps - self.second_mps)
        (east, north) = self.along
        return np.stack([along * east - across * north, along * north + across * east, up])

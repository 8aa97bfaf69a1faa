"""The tuning of `turntable`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from plumb.spec.tuning import Channel, ForOnePeriod

Layer = Literal["data", "attitude", "printed"]


@dataclass(frozen=True)
class Prefilter:
    """Prefilter of one sensor. spike: a sample further than this (in the sensor's unit) from the line through the last
    two is a spike. smooth: weight of a new sample in a one-pole low-pass; 1 for no low-pass."""

    spike: float
    smooth: float = 1.0


@dataclass(frozen=True)
class Fusion:
    """Settings of the fusion of gyro and angular accelerometer. layer: compares rates (data, printed) or attitudes.

    gyro_phase_s: a sampling instant of the gyro, from the first step. rest_s: length of the rest at the beginning.
    lag_s: of the gyro. Noise as densities: gyro (deg/s per root Hz), angular accelerometer (deg/s^2 per root Hz;
    lost_...: the value while it is lost), random walks of both biases (deg/s and deg/s^2 per root s). Initial standard
    deviations: both biases (deg/s, deg/s^2), scale error of each sensor, lag (s); with 0, scale or lag is not
    estimated.
    """

    layer: Layer = "data"
    gyro_period_s: float = 0.01
    gyro_phase_s: float = 0.0
    rest_s: float = 10.0
    lag_s: float = 0.008
    gyro_dps: float = 0.03
    angular_dps2: float = 0.3
    lost_dps2: float = 30.0
    gyro_walk_dps: float = 0.003
    angular_walk_dps2: float = 0.003
    start_gyro_dps: float = 1.0
    start_angular_dps2: float = 2.0
    gyro_scale: float = 0.005
    angular_scale: float = 0.005
    start_lag_s: float = 0.003


@dataclass(frozen=True)
class TurntableTuning(ForOnePeriod):
    """The settings of a run of `turntable`. A step is one sample of the angular accelerometer."""

    system: ClassVar[str] = "turntable"

    period_us: int
    gyro: Channel
    angular: Channel
    gyro_filter: Prefilter
    angular_filter: Prefilter
    fusion: Fusion
    exact_period_s: float | None = None

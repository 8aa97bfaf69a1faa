"""The tuning of `turntable`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from plumb.spec.tuning import CHOICE, NUMBER, Channel, ForOnePeriod, quantity

Layer = Literal["data", "attitude", "printed"]


@dataclass(frozen=True)
class Prefilter:
    """Prefilter of one sensor. spike: a sample further than this (in the sensor's unit) from the line through the last
    two is a spike. smooth: weight of a new sample in a one-pole low-pass; 1 for no low-pass."""

    spike: float = field(
        metadata=quantity("unit", "a sample further than this from the line through the last two is a spike")
    )
    smooth: float = field(
        default=1.0, metadata=quantity(NUMBER, "weight of a new sample in the one-pole low-pass; 1 is no low-pass")
    )


@dataclass(frozen=True)
class Fusion:
    """Settings of the fusion of gyro and angular accelerometer. layer: compares rates (data, printed) or attitudes.

    gyro_phase_s: a sampling instant of the gyro, from the first step. rest_s: length of the rest at the beginning.
    lag_s: of the gyro. Noise as densities: gyro (deg/s per root Hz), angular accelerometer (deg/s^2 per root Hz;
    lost_...: the value while it is lost), random walks of both biases (deg/s and deg/s^2 per root s). Initial standard
    deviations: both biases (deg/s, deg/s^2), scale error of each sensor, lag (s); with 0, scale or lag is not
    estimated.
    """

    layer: Layer = field(
        default="data", metadata=quantity(CHOICE, "what is compared: rates (data, printed) or attitudes (attitude)")
    )
    gyro_period_s: float = field(default=0.01, metadata=quantity("s", "sampling period of the gyro"))
    gyro_phase_s: float = field(
        default=0.0, metadata=quantity("s", "a sampling instant of the gyro, from the first step")
    )
    rest_s: float = field(default=10.0, metadata=quantity("s", "length of the rest at the beginning"))
    lag_s: float = field(default=0.008, metadata=quantity("s", "lag of the gyro"))
    gyro_dps: float = field(default=0.03, metadata=quantity("deg/s per sqrt(Hz)", "noise density of the gyro"))
    angular_dps2: float = field(
        default=0.3, metadata=quantity("deg/s^2 per sqrt(Hz)", "noise density of the angular accelerometer")
    )
    lost_dps2: float = field(
        default=30.0,
        metadata=quantity("deg/s^2 per sqrt(Hz)", "noise density of the angular accelerometer while it is lost"),
    )
    gyro_walk_dps: float = field(
        default=0.003, metadata=quantity("deg/s per sqrt(s)", "random walk of the gyro's bias")
    )
    angular_walk_dps2: float = field(
        default=0.003,
        metadata=quantity("deg/s^2 per sqrt(s)", "random walk of the angular accelerometer's bias"),
    )
    start_gyro_dps: float = field(
        default=1.0, metadata=quantity("deg/s", "standard deviation of the gyro's bias at the start")
    )
    start_angular_dps2: float = field(
        default=2.0, metadata=quantity("deg/s^2", "standard deviation of the angular accelerometer's bias at the start")
    )
    gyro_scale: float = field(
        default=0.005, metadata=quantity(NUMBER, "standard deviation of the gyro's scale error; 0: not estimated")
    )
    angular_scale: float = field(
        default=0.005,
        metadata=quantity(NUMBER, "standard deviation of the angular accelerometer's scale error; 0: not estimated"),
    )
    start_lag_s: float = field(
        default=0.003, metadata=quantity("s", "standard deviation of the gyro's lag at the start; 0: not estimated")
    )


@dataclass(frozen=True)
class TurntableTuning(ForOnePeriod):
    """The settings of a run of `turntable`. A step is one sample of the angular accelerometer."""

    system: ClassVar[str] = "turntable"

    period_us: int
    gyro: Channel = field(metadata=quantity("deg/s", "angular rate"))
    angular: Channel = field(metadata=quantity("deg/s^2", "angular acceleration"))
    gyro_filter: Prefilter = field(metadata=quantity("deg/s", "angular rate"))
    angular_filter: Prefilter = field(metadata=quantity("deg/s^2", "angular acceleration"))
    fusion: Fusion
    exact_period_s: float | None = None

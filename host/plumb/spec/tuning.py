"""Tuning: the settings of a system in engineering units, before quantisation.

Frozen dataclasses of floats, in the order of the data flow; names carry the units: deg, deg/s (dps), g, s, us. Every
field says its unit and its meaning with `quantity`, from which `plumb params` and `board.params` take them. This module
has the settings of the kernels that systems share (Pid and Esc are declared in parameters.toml); a system's own tuning
is in `plumb.systems.NAME.tuning`.
`plumb.contract.parameters` converts a tuning to the integers of the firmware and back; `plumb.contract.run_reference`
uses a tuning directly.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field
from typing import Any, ClassVar, Literal, Protocol

from plumb.spec.quantity import CHOICE as CHOICE
from plumb.spec.quantity import NUMBER as NUMBER
from plumb.spec.quantity import Quantity as Quantity
from plumb.spec.quantity import quantity as quantity
from plumb.spec.shared_settings import Esc as Esc
from plumb.spec.shared_settings import Pid as Pid

TiltMode = Literal["arcsine", "atan2"]
RateChoice = Literal["previous", "current", "trapezium"]
"""Trapezium: the mean of both samples."""


@dataclass(frozen=True)
class Channel:
    """One sensor channel: value = (clamp(raw, min_counts, max_counts) - zero_counts) * unit_per_count."""

    zero_counts: float = field(metadata=quantity("count", "raw count that stands for 0"))
    unit_per_count: float = field(metadata=quantity("unit per count", "value of one count; its sign turns the axis"))
    min_counts: int = field(
        default=0, metadata=quantity("count", "lowest plausible count; lower ones are clamped and counted")
    )
    max_counts: int = field(
        default=4095, metadata=quantity("count", "highest plausible count; higher ones are clamped and counted")
    )


@dataclass(frozen=True)
class Calibration:
    """The three channels of one axis: gyro in deg/s, acceleration along the axis that is horizontal at tilt 0 and along
    the one that points up then, in g."""

    gyro: Channel = field(metadata=quantity("deg/s", "angular rate"))
    accel: Channel = field(metadata=quantity("g", "acceleration along the axis that is horizontal at tilt 0"))
    accel_up: Channel = field(metadata=quantity("g", "acceleration along the axis that points up at tilt 0"))


@dataclass(frozen=True)
class Trust:
    """Measurement variance R from the magnitude of the acceleration a.

    R = min(r_deg2 + gain_deg2 * (|a|^2 - 1 g^2)^2, r_max_deg2). gain_deg2 is in deg^2 per g^4; 0 gives a constant R.
    |a| is computed from both accelerometer axes.
    """

    r_deg2: float = field(metadata=quantity("deg^2", "measurement variance R of the tilt at |a| = 1 g", "kalman.r"))
    gain_deg2: float = field(
        default=0.0,
        metadata=quantity("deg^2 per g^4", "growth of R with the square of |a|^2 - 1 g^2; 0 keeps R constant"),
    )
    r_max_deg2: float = field(default=1000.0, metadata=quantity("deg^2", "largest R", "kalman.r_max"))


@dataclass(frozen=True)
class Kalman:
    """Process noise as densities: Q of one step is the density times the period. rate: the gyro sample used as U(k).

    The bias that is published and subtracted from the rate is limited to +-bias_max_dps (below 360).
    """

    q_angle_deg2_per_s: float = field(metadata=quantity("deg^2/s", "process noise Q of the angle, per second"))
    q_bias_dps2_per_s: float = field(metadata=quantity("(deg/s)^2/s", "process noise Q of the gyro's bias, per second"))
    rate: RateChoice = field(default="previous", metadata=quantity(CHOICE, "gyro sample that drives the prediction"))
    bias_max_dps: float = field(default=300.0, metadata=quantity("deg/s", "limit of the published gyro bias"))

    @classmethod
    def per_step(cls, q_angle_deg2: float, q_bias_dps2: float, period_us: int, rate: RateChoice = "previous") -> Kalman:
        """From the Q that is added at every step, as papers state it. period_us: of the step."""
        steps_per_s = 1e6 / period_us
        return cls(q_angle_deg2 * steps_per_s, q_bias_dps2 * steps_per_s, rate)


@dataclass(frozen=True)
class Start:
    """State and covariance before the first sample."""

    tilt_deg: float = field(default=0.0, metadata=quantity("deg", "angle before the first sample"))
    bias_dps: float = field(default=0.0, metadata=quantity("deg/s", "gyro bias before the first sample"))
    p00_deg2: float = field(default=900.0, metadata=quantity("deg^2", "variance of the angle before the first sample"))
    p01_deg2_per_s: float = field(
        default=0.0, metadata=quantity("deg^2/s", "covariance of angle and bias before the first sample")
    )
    p11_dps2: float = field(
        default=25.0, metadata=quantity("(deg/s)^2", "variance of the bias before the first sample")
    )


TILT_MEANING = "tilt from acceleration: arcsine of the horizontal axis / 1 g, or atan2 with the axis upwards"


class ForOnePeriod:
    """A tuning for one sample period; another period needs another tuning.

    exact_period_s: the quantised period, in a dequantised tuning; at most 2^-35 s from period_us.
    """

    period_us: int
    exact_period_s: float | None

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6 if self.exact_period_s is None else self.exact_period_s


@dataclass(frozen=True, kw_only=True)
class AxisTuning(ForOnePeriod):
    """Settings of a one-axis system with gyro, accelerometer and controller; a system adds its own."""

    system: ClassVar[str]

    period_us: int
    calibration: Calibration
    kalman: Kalman
    trust: Trust
    tilt: TiltMode = field(default="atan2", metadata=quantity(CHOICE, TILT_MEANING))
    start: Start = field(default_factory=Start)
    pid: Pid = field(default_factory=Pid)
    exact_period_s: float | None = None


class AnyTuning(Protocol):
    """The tuning of any system: a frozen dataclass; `system` is the name of the system."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]  # Any: what dataclasses.replace asks for, as typeshed has it

    system: ClassVar[str]

    @property
    def period_us(self) -> int:
        """Period of a step."""

    @property
    def period_s(self) -> float:
        """The period in s; in a dequantised tuning the quantised period."""

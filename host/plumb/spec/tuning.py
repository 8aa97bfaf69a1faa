"""A tuning in engineering units: what a person sets, before anything is an integer.

Frozen dataclasses of plain floats, in the order of the data flow; names carry the units: deg, deg/s (dps), g, s, us.
Here are the settings of kernels that systems share; the tuning of a system is `plumb.systems.NAME.tuning`.
`plumb.tuning.quantise` turns a Tuning into the integers of the firmware and back; `plumb.systems.run_reference` runs on
a Tuning directly.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field
from typing import Any, ClassVar, Literal, Protocol

TiltMode = Literal["arcsine", "atan2"]
RateChoice = Literal["previous", "current"]


@dataclass(frozen=True)
class Channel:
    """One sensor channel: value = (clamp(raw, min_counts, max_counts) - zero_counts) * unit_per_count."""

    zero_counts: float
    unit_per_count: float
    min_counts: int = 0
    max_counts: int = 4095


@dataclass(frozen=True)
class Calibration:
    """The three channels of one axis: gyro in deg/s, acceleration along the axis that is horizontal at tilt 0 and along
    the one that points up then, in g."""

    gyro: Channel
    accel: Channel
    accel_up: Channel


@dataclass(frozen=True)
class Trust:
    """Measurement variance from the length of the acceleration: R = min(r_deg2 + gain * (|a|^2 - 1 g^2)^2, r_max_deg2).

    gain_deg2 is in deg^2 per g^4; zero gives a constant R. |a| needs both accelerometer axes.
    """

    r_deg2: float
    gain_deg2: float = 0.0
    r_max_deg2: float = 1000.0


@dataclass(frozen=True)
class Kalman:
    """Process noise as densities: Q of one step is the density times the period. rate: which gyro sample is U(k).

    The bias that is published and taken off the rate stays within +-bias_max_dps, which is below 360.
    """

    q_angle_deg2_per_s: float
    q_bias_dps2_per_s: float
    rate: RateChoice = "previous"
    bias_max_dps: float = 300.0

    @classmethod
    def per_step(cls, q_angle_deg2: float, q_bias_dps2: float, period_us: int, rate: RateChoice = "previous") -> Kalman:
        """The Q that is added at every step, as the papers print it."""
        steps_per_s = 1e6 / period_us
        return cls(q_angle_deg2 * steps_per_s, q_bias_dps2 * steps_per_s, rate)


@dataclass(frozen=True)
class Start:
    """State and covariance before the first sample."""

    tilt_deg: float = 0.0
    bias_dps: float = 0.0
    p00_deg2: float = 900.0
    p01_deg2_per_s: float = 0.0
    p11_dps2: float = 25.0


@dataclass(frozen=True)
class Pid:
    """Command in [-1, 1] from the tilt error in deg; D acts on the measured rate behind a first-order filter.

    What share of the actuator a command of 1 is, and its direction, is the span of Esc.
    """

    kp_per_deg: float = 0.0
    ki_per_deg_s: float = 0.0
    kd_per_dps: float = 0.0
    derivative_tau_s: float = 0.0
    slew_per_s: float = 1000.0


@dataclass(frozen=True)
class Esc:
    """Pulses of the two opposing motors: mid +- span * command, clamped to [min, max]; neutral while disarmed."""

    mid_us: float = 1500.0
    span_us: float = 400.0
    min_us: float = 1000.0
    max_us: float = 2000.0
    neutral_us: float = 1000.0


class ForOnePeriod:
    """A tuning is for one period; another period is another tuning.

    exact_period_s: what the integers make of the period, in a dequantised tuning (2^-35 s at most beside it).
    """

    period_us: int
    exact_period_s: float | None

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6 if self.exact_period_s is None else self.exact_period_s


@dataclass(frozen=True, kw_only=True)
class AxisTuning(ForOnePeriod):
    """What every system of one axis with a gyro, an accelerometer and a controller needs; a system adds its own."""

    system: ClassVar[str]

    period_us: int
    calibration: Calibration
    kalman: Kalman
    trust: Trust
    tilt: TiltMode = "atan2"
    start: Start = field(default_factory=Start)
    pid: Pid = field(default_factory=Pid)
    exact_period_s: float | None = None


class AnyTuning(Protocol):
    """The tuning of any system: a frozen dataclass of its own; `system` says which."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]  # Any: what dataclasses.replace asks for, as typeshed has it

    system: ClassVar[str]

    @property
    def period_us(self) -> int:
        """Period of a step."""

    @property
    def period_s(self) -> float:
        """The same in s; what the integers make of it in a dequantised tuning."""

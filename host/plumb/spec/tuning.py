"""Tuning: the settings of a system in engineering units, before quantisation.

Frozen dataclasses of floats, in the order of the data flow; names carry the units: deg, deg/s (dps), g, s, us. This
module has the settings of the kernels that systems share; a system's own tuning is in `plumb.systems.NAME.tuning`.
`plumb.tuning.quantise` converts a tuning to the integers of the firmware and back; `plumb.systems.run_reference` uses a
tuning directly.
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
    """Measurement variance R from the magnitude of the acceleration a.

    R = min(r_deg2 + gain_deg2 * (|a|^2 - 1 g^2)^2, r_max_deg2). gain_deg2 is in deg^2 per g^4; 0 gives a constant R.
    |a| is computed from both accelerometer axes.
    """

    r_deg2: float
    gain_deg2: float = 0.0
    r_max_deg2: float = 1000.0


@dataclass(frozen=True)
class Kalman:
    """Process noise as densities: Q of one step is the density times the period. rate: the gyro sample used as U(k).

    The bias that is published and subtracted from the rate is limited to +-bias_max_dps (below 360).
    """

    q_angle_deg2_per_s: float
    q_bias_dps2_per_s: float
    rate: RateChoice = "previous"
    bias_max_dps: float = 300.0

    @classmethod
    def per_step(cls, q_angle_deg2: float, q_bias_dps2: float, period_us: int, rate: RateChoice = "previous") -> Kalman:
        """From the Q that is added at every step, as papers state it. period_us: of the step."""
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
    """Command in [-1, 1] from the tilt error in deg. The D term acts on the measured rate behind a first-order
    low-pass.

    slew_per_s: largest change of the command per second. Esc.span_us sets what a command of 1 does and its direction.
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
    tilt: TiltMode = "atan2"
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

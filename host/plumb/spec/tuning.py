"""A tuning in engineering units: what a person sets, before anything is an integer.

Frozen dataclasses of plain floats, in the order of the data flow; names carry the units: deg, deg/s (dps), g, s, us.
`plumb.tuning.quantise` turns a Tuning into the integers of the firmware and back; `plumb.systems.run_reference` runs on
a Tuning directly.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal, Protocol

TiltMode = Literal["arcsine", "atan2"]
RateChoice = Literal["previous", "current"]
PhoneRates = Literal["body", "euler"]


@dataclass(frozen=True)
class Channel:
    """One sensor channel: value = (clamp(raw, min_counts, max_counts) - zero_counts) * unit_per_count."""

    zero_counts: float
    unit_per_count: float
    min_counts: int = 0
    max_counts: int = 4095


@dataclass(frozen=True)
class Calibration:
    """The three channels of one axis: gyro in deg/s, acceleration along y and z in g."""

    gyro: Channel
    accel_y: Channel
    accel_z: Channel


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


@dataclass(frozen=True)
class Tuning(ForOnePeriod):
    """Everything one run of `quad` needs."""

    system: ClassVar[str] = "quad"

    period_us: int
    calibration: Calibration
    kalman: Kalman
    trust: Trust
    tilt: TiltMode = "arcsine"
    start: Start = field(default_factory=Start)
    pid: Pid = field(default_factory=Pid)
    esc: Esc = field(default_factory=Esc)
    exact_period_s: float | None = None


@dataclass(frozen=True)
class Wheel:
    """Hall edges to speed: way of the axle per edge, and the filter of the speed. accel_share: how much of its slope is
    taken off the forward axis before the arctangent; 0 is the source's. More than edges_max edges in a period are
    clamped, and counted.
    """

    edge_m: float
    edges_max: int
    tau_s: float = 0.2
    accel_share: float = 1.0


@dataclass(frozen=True)
class SpeedLoop:
    """The lean asked for by velocity error: proportional, integral (deg per m of way), against the axle's acceleration.

    Leans up to lean_max_deg and changes by up to lean_slew_dps; asked for at most speed_max_mps.
    """

    lean_deg_per_mps: float = 0.0
    lean_deg_per_m: float = 0.0
    lean_deg_per_g: float = 0.0
    accel_tau_s: float = 0.0
    lean_max_deg: float = 8.0
    lean_slew_dps: float = 1e4
    speed_max_mps: float = 1.0


@dataclass(frozen=True)
class Drive:
    """Duty of the bridge from the command, -1..1: span, with the sign that a positive command makes the tilt grow, and
    so drives backwards; beyond fall_deg the bridge stays at 0 until the run ends.
    """

    span: float = -32767 / 32768
    duty_max: float = 32767 / 32768
    fall_deg: float = 45.0


@dataclass(frozen=True)
class BalancerTuning(ForOnePeriod):
    """Everything one run of `balancer` needs.

    calibration.accel_y is the forward axis, its sign such that it reads sin(tilt) at rest.
    """

    system: ClassVar[str] = "balancer"

    period_us: int
    calibration: Calibration
    wheel: Wheel
    kalman: Kalman
    trust: Trust
    tilt: TiltMode = "atan2"
    start: Start = field(default_factory=Start)
    speed: SpeedLoop = field(default_factory=SpeedLoop)
    pid: Pid = field(default_factory=Pid)
    drive: Drive = field(default_factory=Drive)
    exact_period_s: float | None = None


@dataclass(frozen=True)
class PhoneAxis:
    """The filter of one angle of `phone`: Q as densities, a constant R, and where it starts."""

    q_angle_deg2_per_s: float
    q_bias_dps2_per_s: float
    r_deg2: float
    start: Start = field(default_factory=lambda: Start(p00_deg2=90.0**2))


@dataclass(frozen=True)
class PhoneTuning(ForOnePeriod):
    """Everything one run of `phone` needs.

    gyro, accel: the channel of all three axes each. rates: what drives the filters, the body's rates as printed or
    those of the angles. r_left_out_deg2: stands in for R where an acceleration tells no angle.
    """

    system: ClassVar[str] = "phone"

    period_us: int
    gyro: Channel
    accel: Channel
    pitch: PhoneAxis
    roll: PhoneAxis
    rates: PhoneRates = "euler"
    r_left_out_deg2: float = 1e3
    rate: RateChoice = "previous"
    bias_max_dps: float = 300.0
    exact_period_s: float | None = None

    def kalman(self, axis: PhoneAxis) -> Kalman:
        """The settings of one axis' filter."""
        return Kalman(axis.q_angle_deg2_per_s, axis.q_bias_dps2_per_s, self.rate, self.bias_max_dps)


Layer = Literal["data", "attitude", "printed"]


@dataclass(frozen=True)
class Prefilter:
    """Before fusion, per sensor: further than `spike` (in the sensor's unit) from the line through the last two samples
    is a spike; `smooth` is the share of a new sample in a one-pole low-pass, 1 for none."""

    spike: float
    smooth: float = 1.0


@dataclass(frozen=True)
class Fusion:
    """Gyro and angular accelerometer. layer: what is compared, rates (data, printed) or attitudes.

    gyro_phase_s: a sampling instant of the gyro, counted from the first step. rest_s: the run begins at rest. lag_s:
    the gyro's. Noise as densities: gyro (deg/s per root Hz), angular accelerometer (deg/s^2 per root Hz; lost_: what
    stands for it while it is lost), walks of both biases (deg/s and deg/s^2 per root s). Standard deviations at the
    start: both biases (deg/s, deg/s^2), the scale error of each sensor, the lag (s); 0 is not estimated.
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
    """Everything one run of `turntable` needs. A step is a sample of the angular accelerometer."""

    system: ClassVar[str] = "turntable"

    period_us: int
    gyro: Channel
    angular: Channel
    gyro_filter: Prefilter
    angular_filter: Prefilter
    fusion: Fusion
    exact_period_s: float | None = None


class AnyTuning(Protocol):
    """The tuning of any system: a frozen dataclass of its own; `system` says which."""

    system: ClassVar[str]

    @property
    def period_us(self) -> int:
        """Period of a step."""

    @property
    def period_s(self) -> float:
        """The same in s; what the integers make of it in a dequantised tuning."""

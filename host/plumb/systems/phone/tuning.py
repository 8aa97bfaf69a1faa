"""The tuning of `phone`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from plumb.spec.tuning import CHOICE, Channel, ForOnePeriod, Kalman, RateChoice, Start, quantity

PhoneRates = Literal["body", "euler"]


@dataclass(frozen=True)
class PhoneAxis:
    """The filter of one angle of `phone`: Q as densities, a constant R, and where it starts."""

    q_angle_deg2_per_s: float = field(metadata=quantity("deg^2/s", "process noise Q of the angle, per second"))
    q_bias_dps2_per_s: float = field(metadata=quantity("(deg/s)^2/s", "process noise Q of the gyro's bias, per second"))
    r_deg2: float = field(metadata=quantity("deg^2", "measurement variance R of the angle"))
    start: Start = field(default_factory=lambda: Start(p00_deg2=90.0**2))


@dataclass(frozen=True)
class PhoneTuning(ForOnePeriod):
    """The settings of a run of `phone`.

    gyro, accel: the channel of all three axes of the sensor. rates: rates that drive the filters, `body` as in the
    source or `euler`. r_left_out_deg2: value of R while the acceleration cannot measure the angle.
    """

    system: ClassVar[str] = "phone"

    period_us: int
    gyro: Channel = field(metadata=quantity("deg/s", "angular rate, all three axes"))
    accel: Channel = field(metadata=quantity("g", "acceleration, all three axes"))
    pitch: PhoneAxis = field(metadata=quantity("", "pitch"))
    roll: PhoneAxis = field(metadata=quantity("", "roll"))
    rates: PhoneRates = field(
        default="euler", metadata=quantity(CHOICE, "rates that drive the filters: of the body, or of the Euler angles")
    )
    r_left_out_deg2: float = field(
        default=1e3, metadata=quantity("deg^2", "R while the acceleration cannot measure the angle")
    )
    rate: RateChoice = field(default="previous", metadata=quantity(CHOICE, "gyro sample that drives the prediction"))
    bias_max_dps: float = field(default=300.0, metadata=quantity("deg/s", "limit of the published gyro bias"))
    exact_period_s: float | None = None

    def kalman(self, axis: PhoneAxis) -> Kalman:
        """The settings of one axis' filter."""
        return Kalman(axis.q_angle_deg2_per_s, axis.q_bias_dps2_per_s, self.rate, self.bias_max_dps)

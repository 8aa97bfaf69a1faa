"""The tuning of `phone`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from plumb.spec.tuning import Channel, ForOnePeriod, Kalman, RateChoice, Start

PhoneRates = Literal["body", "euler"]


@dataclass(frozen=True)
class PhoneAxis:
    """The filter of one angle of `phone`: Q as densities, a constant R, and where it starts."""

    q_angle_deg2_per_s: float
    q_bias_dps2_per_s: float
    r_deg2: float
    start: Start = field(default_factory=lambda: Start(p00_deg2=90.0**2))


@dataclass(frozen=True)
class PhoneTuning(ForOnePeriod):
    """The settings of a run of `phone`.

    gyro, accel: the channel of all three axes of the sensor. rates: rates that drive the filters, `body` as in the
    source or `euler`. r_left_out_deg2: value of R while the acceleration cannot measure the angle.
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

"""The tuning of `wheels`, in engineering units. A command of 1 is the full duty of a motor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, ForOnePeriod, quantity
from plumb.systems.balancer.tuning import BalancerTuning


@dataclass(frozen=True)
class Turning:
    """The turn rate: how it is measured, asked for and controlled."""

    count_m: float = field(metadata=quantity("m", "way of a wheel per count of its encoder"))
    track_m: float = field(metadata=quantity("m", "distance between the wheels; its sign turns the direction"))
    rate_max_dps: float = field(default=90.0, metadata=quantity("deg/s", "turn rate that a full stick asks for"))
    kp_per_dps: float = field(default=0.0, metadata=quantity("1/(deg/s)", "proportional gain: duty by the error"))
    ki_per_deg: float = field(default=0.0, metadata=quantity("1/deg", "integral gain: duty by the error and its time"))
    kd_per_dps2: float = field(
        default=0.0, metadata=quantity("1/(deg/s^2)", "derivative gain: duty against the change of the rate")
    )
    ff_per_dps: float = field(
        default=0.0, metadata=quantity("1/(deg/s)", "feed-forward: duty by the rate that is asked for")
    )
    integral_max: float = field(default=0.25, metadata=quantity(NUMBER, "largest integral part of the duty"))
    duty_max: float = field(default=0.4, metadata=quantity(NUMBER, "largest duty for turning"))
    bias_tau_s: float = field(
        default=5.0, metadata=quantity("s", "time constant with which the gyro's bias follows the wheels")
    )
    doubt_dps: float = field(
        default=2.0, metadata=quantity("deg/s", "largest disagreement of gyro and wheels that counts for the bias")
    )
    slip_dps: float = field(
        default=60.0, metadata=quantity("deg/s", "disagreement of gyro and wheels that shows a slipping wheel")
    )
    slip_s: float = field(default=0.1, metadata=quantity("s", "time for which a wheel then counts as slipping"))
    slip_mps: float = field(
        default=0.1, metadata=quantity("m/s", "change of the speed that is asked for at most while a wheel slips")
    )
    wheels_max_dps: float = field(
        default=1080.0, metadata=quantity("deg/s", "largest turn rate that the wheels may show; more is clamped")
    )


@dataclass(frozen=True)
class Riding:
    """The rider's switch, and the receiver."""

    absent_s: float = field(
        default=0.3, metadata=quantity("s", "time without the rider after which the vehicle comes to rest")
    )
    stopping_s: float = field(default=2.0, metadata=quantity("s", "time after which its motors then stop"))
    up_deg: float = field(default=10.0, metadata=quantity("deg", "largest tilt at which it then takes a rider again"))
    lost_s: float = field(
        default=0.2, metadata=quantity("s", "time without a new frame after which the receiver is lost")
    )


@dataclass(frozen=True)
class Watching:
    """What is not believed: encoders and accelerometer that contradict each other, and wheels in the air. The speed
    that is felt is that of the wheels slowly and the sum of the acceleration quickly."""

    apart_mps: float = field(
        default=0.4, metadata=quantity("m/s", "speed felt beyond which wheels that never counted are not believed")
    )
    apart_tau_s: float = field(
        default=1.0, metadata=quantity("s", "time constant with which the speed that is felt follows the wheels")
    )
    dead_s: float = field(
        default=0.25, metadata=quantity("s", "time without a count of either wheel after which they may be dead")
    )
    rocked_deg: float = field(
        default=1.5, metadata=quantity("deg", "way that the body rocks in that time if they are, to and fro together")
    )
    full_s: float = field(
        default=1.0, metadata=quantity("s", "time at 7/8 of the full duty, after which wheels turn in the air")
    )
    still_s: float = field(
        default=0.1,
        metadata=quantity("s", "time with a repeated count of the accelerometer after which it is not believed"),
    )


@dataclass(frozen=True, kw_only=True)
class WheelsTuning(ForOnePeriod):
    """The settings of a run of `wheels`. balance: its edges are counts of both encoders together; its own period is not
    used."""

    system: ClassVar[str] = "wheels"

    period_us: int
    balance: BalancerTuning = field(metadata=quantity(NUMBER, "balance"))
    turning: Turning = field(metadata=quantity(NUMBER, "turning"))
    riding: Riding = field(default_factory=Riding)
    watching: Watching = field(default_factory=Watching)
    exact_period_s: float | None = None

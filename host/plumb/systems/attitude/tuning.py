"""The tuning of `attitude`, in engineering units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, Channel, ForOnePeriod, quantity

Row = tuple[float, float, float]


@dataclass(frozen=True)
class Mounting:
    """The matrix that turns a sensor's axes to the body's: its axis map, and what corrects scale and misalignment."""

    xx: float = field(default=1.0, metadata=quantity(NUMBER, "share of the sensor's x in the body's x"))
    xy: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's y in the body's x"))
    xz: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's z in the body's x"))
    yx: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's x in the body's y"))
    yy: float = field(default=1.0, metadata=quantity(NUMBER, "share of the sensor's y in the body's y"))
    yz: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's z in the body's y"))
    zx: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's x in the body's z"))
    zy: float = field(default=0.0, metadata=quantity(NUMBER, "share of the sensor's y in the body's z"))
    zz: float = field(default=1.0, metadata=quantity(NUMBER, "share of the sensor's z in the body's z"))

    @classmethod
    def of(cls, matrix: Sequence[Sequence[float]]) -> Mounting:
        """From three rows of three numbers."""
        return cls(*(float(entry) for row in matrix for entry in row))

    @property
    def matrix(self) -> tuple[Row, Row, Row]:
        """Its rows."""
        return (self.xx, self.xy, self.xz), (self.yx, self.yy, self.yz), (self.zx, self.zy, self.zz)


@dataclass(frozen=True)
class Gyro:
    """Errors of the gyro that the filter expects: standard deviations before the first sample, and noise.

    turn_noise stands for what the model of bias and scale leaves out: misalignment, lag, bending.
    """

    bias_dps: float = field(
        default=2.0, metadata=quantity("deg/s", "standard deviation of the bias before the first sample")
    )
    scale: float = field(
        default=0.0055, metadata=quantity(NUMBER, "standard deviation of the scale error before the first sample")
    )
    bias_walk_dps: float = field(default=0.017, metadata=quantity("deg/s per sqrt(s)", "random walk of the bias"))
    noise_dps: float = field(default=0.0018, metadata=quantity("deg/s per sqrt(Hz)", "noise density of the gyro"))
    turn_noise: float = field(
        default=0.001, metadata=quantity("deg/s per sqrt(Hz), per deg/s", "noise density for every deg/s of rate")
    )
    scale_walk: float = field(default=8e-06, metadata=quantity("per sqrt(s)", "random walk of the scale error"))
    clipped_deg: float = field(
        default=5.7,
        metadata=quantity("deg", "standard deviation of the tilt that a block without any sample adds"),
    )
    turn_doubt: float = field(
        default=0.0084,
        metadata=quantity(
            "deg/s per sqrt(Hz), per deg/s and m/s",
            "what every m/s of a lasting velocity beyond `motion.velocity_mps` adds to `turn_noise`",
        ),
    )


@dataclass(frozen=True)
class Motion:
    """How a body moves: it accelerates, but does not move away; and what a velocity that lasts tells."""

    velocity_mps: float = field(
        default=0.343, metadata=quantity("m/s", "standard deviation of the velocity of a body that moves little")
    )
    share: float = field(
        default=0.4,
        metadata=quantity(
            NUMBER, "share of the mean square of the integrated velocity that is added to the square of `velocity_mps`"
        ),
    )
    pass_s: float = field(default=1.0, metadata=quantity("s", "time constant of that mean square"))
    leak_s: float = field(
        default=200.0, metadata=quantity("s", "time constant with which the integrated velocity forgets")
    )
    start_tilt_deg: float = field(
        default=20.0, metadata=quantity("deg", "standard deviation of the tilt before the first sample")
    )
    start_velocity_mps: float = field(
        default=1.2, metadata=quantity("m/s", "standard deviation of the velocity before the first sample")
    )
    unsure_deg: float = field(
        default=5.0, metadata=quantity("deg", "standard deviation of the tilt from which it is flagged")
    )
    travel_mps: float = field(
        default=2.0, metadata=quantity("m/s", "lasting velocity beyond which the body travels, and the tilt waits")
    )
    travel_s: float = field(default=3.0, metadata=quantity("s", "time over which a velocity lasts"))


@dataclass(frozen=True)
class Rest:
    """What counts as rest, which measures the bias."""

    gyro_dps: float = field(
        default=1.15, metadata=quantity("deg/s", "largest distance of a rate from the mean of the block before")
    )
    accel_g: float = field(
        default=0.005,
        metadata=quantity("g", "largest distance of a block's mean acceleration from that of the block before"),
    )
    turn_dps: float = field(
        default=11.5, metadata=quantity("deg/s", "largest mean rate of a block; beyond it is a turn, no bias")
    )
    seconds: float = field(default=1.0, metadata=quantity("s", "time without motion that counts as rest"))
    noise_dps: float = field(default=0.115, metadata=quantity("deg/s", "standard deviation of a block's mean rate"))


@dataclass(frozen=True)
class Aid:
    """What tells the velocity of a vehicle in flight: the drag of its rotors, which grows with the speed in air."""

    drag_per_s: float = field(
        default=0.0, metadata=quantity("1/s", "drag of the rotors by mass and speed; 0: no vehicle, or no such aid")
    )
    velocity_mps: float = field(
        default=2.0, metadata=quantity("m/s", "standard deviation of the velocity that the drag tells")
    )
    hover: float = field(
        default=0.0,
        metadata=quantity(NUMBER, "thrust command of a hover, share of the most, learned in flight; 0: unknown"),
    )


@dataclass(frozen=True)
class AttitudeTuning(ForOnePeriod):
    """The settings of a run of `attitude`. A block has at least 15 samples."""

    system: ClassVar[str] = "attitude"

    period_us: int
    gyro: Channel = field(metadata=quantity("deg/s", "angular rate, all three axes"))
    accel: Channel = field(metadata=quantity("g", "acceleration, all three axes"))
    gyro_mounting: Mounting = field(default_factory=Mounting, metadata=quantity("", "gyro"))
    accel_mounting: Mounting = field(default_factory=Mounting, metadata=quantity("", "accelerometer"))
    errors: Gyro = field(default_factory=Gyro, metadata=quantity("", "gyro"))
    motion: Motion = field(default_factory=Motion, metadata=quantity("", "motion"))
    rest: Rest = field(default_factory=Rest, metadata=quantity("", "rest"))
    aid: Aid = field(default_factory=Aid, metadata=quantity("", "aid of a vehicle"))
    block_s: float = field(default=0.12, metadata=quantity("s", "time between two measurements of the filter"))
    exact_period_s: float | None = None

"""The tuning of `attitude`, in engineering units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, Channel, ForOnePeriod, quantity
from plumb.systems.attitude.settings import Aid, Gyro, Motion, Rest

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
class AttitudeTuning(ForOnePeriod):
    """The settings of a run of `attitude`; system.toml declares most of its groups. A block has at least 15 samples."""

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

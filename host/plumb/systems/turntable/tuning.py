"""The tuning of `turntable`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import Channel, ForOnePeriod, quantity
from plumb.systems.turntable.settings import Fusion, Prefilter


@dataclass(frozen=True)
class TurntableTuning(ForOnePeriod):
    """The settings of a run of `turntable`; system.toml declares its own groups. A step is one sample of the
    angular accelerometer."""

    system: ClassVar[str] = "turntable"

    period_us: int
    gyro: Channel = field(metadata=quantity("deg/s", "angular rate"))
    angular: Channel = field(metadata=quantity("deg/s^2", "angular acceleration"))
    gyro_filter: Prefilter = field(metadata=quantity("deg/s", "angular rate"))
    angular_filter: Prefilter = field(metadata=quantity("deg/s^2", "angular acceleration"))
    fusion: Fusion
    exact_period_s: float | None = None

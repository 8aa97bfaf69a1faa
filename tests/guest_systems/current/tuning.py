"""The tuning of `current`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, quantity

PERIOD_US = 1000


@dataclass(frozen=True)
class CurrentTuning:
    """The settings of a run of `current`."""

    system: ClassVar[str] = "current"

    period_us: int = PERIOD_US
    zero_counts: int = field(default=2048, metadata=quantity("count", "count at no current"))
    amps_per_count: float = field(default=5120 / 2**20, metadata=quantity("A", "current of one count"))
    kp_per_a: float = field(default=0.1, metadata=quantity("1/A", "proportional gain"))
    ki_per_a_s: float = field(default=20.0, metadata=quantity("1/(A s)", "integral gain"))
    duty_max: float = field(default=0.9, metadata=quantity(NUMBER, "largest duty"))
    trip_a: float = field(default=8.0, metadata=quantity("A", "more than this for three steps disarms"))

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6

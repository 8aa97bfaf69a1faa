"""The tuning of `gantry`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import quantity

PERIOD_US = 10_000


@dataclass(frozen=True)
class GantryTuning:
    """The settings of a run of `gantry`."""

    system: ClassVar[str] = "gantry"

    period_us: int = PERIOD_US
    most_counts: int = field(default=40, metadata=quantity("count", "how far a slide goes in a step, at most"))

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6

"""The tuning of `toy`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, quantity

PERIOD_US = 10_000


@dataclass(frozen=True)
class ToyTuning:
    """The settings of a run of `toy`."""

    system: ClassVar[str] = "toy"

    period_us: int = PERIOD_US
    largest_counts: int = field(default=4095, metadata=quantity("count", "largest count; larger ones are clamped"))
    share: float = field(default=0.1, metadata=quantity(NUMBER, "share of a new count in the filtered level"))

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6

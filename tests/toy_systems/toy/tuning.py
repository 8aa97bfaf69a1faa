"""The tuning of `toy`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

PERIOD_US = 10_000


@dataclass(frozen=True)
class ToyTuning:
    """share: of a new count in the filtered level."""

    system: ClassVar[str] = "toy"

    period_us: int = PERIOD_US
    largest_counts: int = 4095
    share: float = 0.1

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6

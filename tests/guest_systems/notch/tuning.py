"""The tuning of `notch`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import quantity

PERIOD_US = 1000


@dataclass(frozen=True)
class NotchTuning:
    """The settings of a run of `notch`."""

    system: ClassVar[str] = "notch"

    period_us: int = PERIOD_US
    centre_hz: float = field(default=50.0, metadata=quantity("Hz", "frequency that is taken out"))
    width_hz: float = field(default=20.0, metadata=quantity("Hz", "width at 3 dB"))

    @property
    def period_s(self) -> float:
        return self.period_us * 1e-6

    def coefficients(self) -> tuple[float, float, float]:
        """b0 = b2, b1 = a1 and a2 of the biquad, by the bilinear transform."""
        turn = 2.0 * math.pi * self.centre_hz * self.period_s
        alpha = math.sin(turn) * self.width_hz / (2.0 * self.centre_hz)
        return 1.0 / (1.0 + alpha), -2.0 * math.cos(turn) / (1.0 + alpha), (1.0 - alpha) / (1.0 + alpha)

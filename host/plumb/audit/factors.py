"""Factors by which units are mistaken, and the sentence of each.

Sensitivities are those of data sheets: InvenSense MPU-6000/6050 (131 to 16.4 LSB per deg/s, 16384 to 2048 LSB per g),
ITG-3205 (14.375), ST L3GD20 (8.75 and 70 mdps), ADXL345 (256 LSB per g).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

G_MPS2 = 9.80665
TOLERANCE = 0.06
"""Share by which a measured factor may be away from a known one."""


@dataclass(frozen=True)
class Factor:
    """value: what the reading is multiplied by to be right; said: the question that it answers."""

    value: float
    said: str


def _counts(sensitivities: tuple[float, ...], unit: str, other: tuple[float, str]) -> list[Factor]:
    ratio, other_unit = other
    found = [Factor(1.0 / one, f"are they counts, of {one:g} per {unit}?") for one in sensitivities]
    text = f"are they counts that were taken for {other_unit}?"
    return found + [Factor(1.0 / one / ratio, f"{text} ({one:g} per {unit})") for one in sensitivities]


GYRO = (
    Factor(1.0, ""),
    Factor(180.0 / math.pi, "is it rad/s?"),
    Factor(math.pi / 180.0, "is it deg/s that was taken for rad/s?"),
    Factor(1e-3, "is it in mdeg/s?"),
    *_counts((131.0, 65.5, 32.8, 16.4, 14.375), "deg/s", (180.0 / math.pi, "rad/s")),
    Factor(0.00875, "are they counts, of 8.75 mdps?"),
    Factor(0.07, "are they counts, of 70 mdps?"),
)
ACCEL = (
    Factor(1.0, ""),
    Factor(1.0 / G_MPS2, "is it m/s2?"),
    Factor(G_MPS2, "is it g that was taken for m/s2?"),
    Factor(1e-3, "is it in mg?"),
    *_counts((16384.0, 8192.0, 4096.0, 2048.0, 256.0), "g", (1.0 / G_MPS2, "m/s2")),
)


def nearest(value: float, known: tuple[Factor, ...], tolerance: float = TOLERANCE) -> Factor | None:
    """The known factor within the tolerance; None for none."""
    if not value > 0.0:
        return None
    best = min(known, key=lambda one: abs(math.log(one.value / value)))
    return best if abs(math.log(best.value / value)) <= math.log1p(tolerance) else None

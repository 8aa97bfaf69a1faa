"""Counts of sensors at rest: no sensor gives the same counts for ever, and a board does not arm on ones that do."""

from __future__ import annotations

import random
from collections.abc import Sequence

SIGMA_LSB = 1.2


def with_noise(counts: Sequence[int], number: int, channels: int = 3) -> tuple[int, ...]:
    """The counts of sample `number`: noise on the first `channels`, the same for the same number."""
    chance = random.Random(f"sample {number}")
    noisy = tuple(count + round(chance.gauss(0.0, SIGMA_LSB)) for count in counts[:channels])
    return noisy + tuple(counts[channels:])

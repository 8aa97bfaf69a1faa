"""Analog sensors at rest on the pins of a virtual board: noise of a few counts, as no sensor is without."""

from __future__ import annotations

import random
from collections.abc import Callable

from plumb.f103.machine import Machine

PINS = ("PA0", "PA1", "PA2", "PA3", "PB0", "PB1")
"""In the order of a system's raw counts."""
LSB_V = 3.3 / 4096


def at_rest(machine: Machine, volts: tuple[float, ...] = (1.35, 1.65, 2.45), noise_lsb: float = 1.0) -> None:
    """Drive the pins: seeded, and the same noise for the same instant."""

    def source(pin: str, level: float) -> Callable[[float], float]:
        return lambda t_s: level + noise_lsb * LSB_V * random.Random(f"{pin} {t_s!r}").gauss(0.0, 1.0)

    for pin, level in zip(PINS, volts, strict=False):
        machine.adc[pin] = source(pin, level)

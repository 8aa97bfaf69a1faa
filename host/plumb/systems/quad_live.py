"""`quad` on the pins of the virtual board: volts into the ADC, pulses out of TIM4."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plumb.f103.machine import Machine
from plumb.f103.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.sensors import adc_counts
from plumb.systems.quad_plant import QuadPlant

SCENARIO = "hold"
SHOWN, TUNING = "motion", "adaptive"
FRAMES = ("RAW_A", "ANGLE", "BIAS")
ADC_PINS = ("PA0", "PA1", "PA2")
"""Gyro, y, z."""
ESC_PINS = ("PB6", "PB7")
FOLLOW_US = 1000
"""How often the plant looks at the PWM pins."""


class Coupling:
    """Joins a plant to a machine's pins; the plant's time 0 is the first conversion of the gyro channel.

    taken: one row a conversion of the gyro channel: its count, and the truth at that moment.
    """

    def __init__(self, machine: Machine, plant: QuadPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[tuple[int, dict[str, float]]] = []
        self._start: int | None = None
        machine.adc[ADC_PINS[0]] = self._gyro_volts
        for index in (1, 2):
            machine.adc[ADC_PINS[index]] = self._accel_volts(index)
        self._follow(machine.now)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else now_s - self._start / TICKS_PER_S

    def _gyro_volts(self, now_s: float) -> float:
        if self._start is None:
            self._start = round(now_s * TICKS_PER_S)
        time_s, plant = self._time_s(now_s), self.plant
        self._advance(time_s)
        volts = plant.volts(time_s)[0]
        self.taken.append((int(adc_counts(np.array(volts))), plant.truth(time_s)))
        return volts

    def _accel_volts(self, index: int) -> Callable[[float], float]:
        return lambda now_s: self.plant.volts(self._time_s(now_s))[index]

    def _advance(self, time_s: float) -> None:
        pulses = [self.machine.pwm(pin) for pin in ESC_PINS]
        self.plant.advance_to(time_s, [pulse.pulse_us if pulse.enabled else 0.0 for pulse in pulses])

    def _follow(self, now: int) -> None:
        self._advance(self._time_s(now / TICKS_PER_S))
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)

"""`quad` on the pins of the virtual board: voltages at the ADC inputs, pulses from TIM4."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.physics.sensors import adc_counts
from plumb.systems.analog_scans import AnalogScans
from plumb.systems.contracts import Conversion
from plumb.systems.quad.plant import QuadPlant

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = "hold"
SHOWN, TUNING = "motion", "hold"
FRAMES = ("RAW_A", "QUAD_ANGLE", "QUAD_BIAS")
ADC_PINS = ("PA0", "PA1", "PA2")
"""Gyro, y, z."""
ESC_PINS = ("PB6", "PB7")
FOLLOW_US = 1000
"""Interval at which the plant reads the PWM pins."""


class QuadCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first sample of the gyro channel.

    A scan of the ADC advances the plant; a pin has the voltage of the last scan. taken: the samples of the gyro
    channel.
    """

    def __init__(self, machine: Machine, plant: QuadPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start: int | None = None
        self._scans = AnalogScans(plant.scenario.period_us, plant.scenario.seed)
        self._volts = (0.0, 0.0, 0.0)
        for index, pin in enumerate(ADC_PINS):
            machine.adc[pin] = self._source(index)
        machine.adc.before_conversion[ADC_PINS[0]] = self._convert
        self._follow(machine.now)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else max(0.0, now_s - self._start / TICKS_PER_S)

    def _convert(self, now_s: float) -> None:
        """The ADC samples the gyro: the first conversion of a scan advances the plant to this moment."""
        scans, plant = self._scans, self.plant
        if not scans.convert(now_s):
            return
        if self._start is None:
            self._start = round((now_s + scans.until_sample_s()) * TICKS_PER_S)
        time_s = self._time_s(now_s)
        self._advance(time_s)
        held = [fault.channel for fault in plant.scenario.faults if fault.start_s <= time_s < fault.stop_s]
        gyro, y, z = (
            volts if channel in held else volts + scans.noise_v() for channel, volts in enumerate(plant.volts(time_s))
        )
        self._volts = gyro, y, z
        if scans.is_sample:
            self.taken.append(Conversion(now_s, int(adc_counts(np.array(gyro))), plant.truth(time_s)))

    def _source(self, index: int) -> Callable[[float], float]:
        return lambda _now_s: self._volts[index]

    def _advance(self, time_s: float) -> None:
        pulses = [self.machine.pwm(pin) for pin in ESC_PINS]
        self.plant.advance_to(time_s, [pulse.pulse_us if pulse.enabled else 0.0 for pulse in pulses])

    def _follow(self, now: int) -> None:
        self._advance(self._time_s(now / TICKS_PER_S))
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)


couple = QuadCoupling

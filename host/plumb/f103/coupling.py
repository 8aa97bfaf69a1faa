"""A plant around the simulated part: its volts drive ADC pins, and the pulses on PWM pins drive it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Protocol

from plumb.f103.machine import Machine

SENSOR_PINS = ("PA0", "PA1", "PA2")
ACTUATOR_PINS = ("PB6", "PB7")
SCAN_S = 200e-6
"""Conversions closer together than this belong to one scan and see the plant at one moment."""


class Plant(Protocol):
    """What simulates itself from 0 s on. pulse_us: 0 where a pin carries no pulses."""

    def advance_to(self, time_s: float, pulse_us: Sequence[float]) -> None: ...

    def volts(self, time_s: float) -> Sequence[float]:
        """One for each sensor pin."""
        ...


class Coupling:
    """Attach with Coupling(machine, plant). The plant's time begins with the next conversion: now, and again after
    each `restart`. It advances when the ADC looks at it, with the pulses of that moment."""

    def __init__(
        self,
        machine: Machine,
        plant: Plant,
        sensor_pins: Sequence[str] = SENSOR_PINS,
        actuator_pins: Sequence[str] = ACTUATOR_PINS,
    ) -> None:
        self.machine = machine
        self.actuator_pins = tuple(actuator_pins)
        for index, pin in enumerate(sensor_pins):
            machine.adc[pin] = partial(self._volts_of, index)
        self.restart(plant)

    def restart(self, plant: Plant) -> None:
        self.plant = plant
        self._begin_s: float | None = None
        self._looked_s = 0.0
        self._volts: Sequence[float] = ()

    def pulses_us(self) -> tuple[float, ...]:
        waves = [self.machine.pwm(pin) for pin in self.actuator_pins]
        return tuple(wave.pulse_us if wave.enabled else 0.0 for wave in waves)

    def _volts_of(self, index: int, time_s: float) -> float:
        return self._look(time_s)[index]

    def _look(self, time_s: float) -> Sequence[float]:
        if self._begin_s is None:
            self._begin_s = time_s
        elif time_s - self._looked_s < SCAN_S:
            return self._volts
        self._looked_s = time_s
        self.plant.advance_to(time_s - self._begin_s, self.pulses_us())
        self._volts = self.plant.volts(time_s - self._begin_s)
        return self._volts

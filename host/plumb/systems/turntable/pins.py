"""`turntable` on the pins of the virtual board: both sensors have analog outputs, connected to six ADC inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.physics.sensors import ADC_COUNTS, ADC_REFERENCE_V
from plumb.systems.analog_scans import SampledPlant
from plumb.systems.turntable.scenarios import TurntablePlant

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = "analog"
SHOWN, TUNING = SCENARIO, SCENARIO
FRAMES = ("RAW_A", "RAW_B", *(f"TURNTABLE_ATTITUDE_{axis}" for axis in "WXYZ"))
ADC_PINS = ("PA0", "PA1", "PA2", "PA3", "PB0", "PB1")
"""Gyro x, y, z, angular acceleration x, y, z."""


class TurntableCoupling(SampledPlant):
    """Connects a plant to a machine's pins. The plant's time 0 is the first sample of the gyro's x axis. The sensors'
    outputs are constant within a step of the plant. taken: the samples of that channel.
    """

    def __init__(self, machine: Machine, plant: TurntablePlant) -> None:
        if plant.name != SCENARIO:
            raise UsageError(
                f"'{plant.name}' is not on the board's own pins: take the scenario and the tuning {SCENARIO}"
            )
        super().__init__(plant, plant.period_us)
        for index, pin in enumerate(ADC_PINS):
            machine.adc[pin] = self._source(index)
        machine.adc.before_conversion[ADC_PINS[0]] = self.convert

    def _source(self, index: int) -> Callable[[float], float]:
        return lambda now_s: self.count(now_s, index) * (ADC_REFERENCE_V / ADC_COUNTS)


couple = TurntableCoupling

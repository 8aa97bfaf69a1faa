"""`turntable` on the pins of the virtual board: both sensors have analog outputs, connected to six ADC inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from plumb.errors import UsageError
from plumb.physics.sensors import ADC_COUNTS, ADC_REFERENCE_V
from plumb.systems.analog_scans import AnalogScans
from plumb.systems.contracts import Conversion
from plumb.systems.turntable.scenarios import TurntablePlant

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = "analog"
SHOWN, TUNING = SCENARIO, SCENARIO
FRAMES = ("RAW_A", "RAW_B", *(f"TURNTABLE_ATTITUDE_{axis}" for axis in "WXYZ"))
ADC_PINS = ("PA0", "PA1", "PA2", "PA3", "PB0", "PB1")
"""Gyro x, y, z, angular acceleration x, y, z."""


class TurntableCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first sample of the gyro's x axis. The sensors'
    outputs are constant within a step of the plant. taken: the samples of that channel.
    """

    def __init__(self, machine: Machine, plant: TurntablePlant) -> None:
        if plant.name != SCENARIO:
            raise UsageError(
                f"'{plant.name}' is not on the board's own pins: take the scenario and the tuning {SCENARIO}"
            )
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start_s: float | None = None
        self._scans = AnalogScans(plant.period_us, 0)
        for index, pin in enumerate(ADC_PINS):
            machine.adc[pin] = self._source(index)
        machine.adc.before_conversion[ADC_PINS[0]] = self._convert

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start_s is None else max(0.0, now_s - self._start_s)

    def _convert(self, now_s: float) -> None:
        """The ADC samples the gyro's x axis."""
        if not self._scans.convert(now_s):
            return
        if self._start_s is None:
            self._start_s = now_s + self._scans.until_sample_s()
        if self._scans.is_sample:
            time_s = self._time_s(now_s)
            self.taken.append(Conversion(now_s, self.plant.counts(time_s)[0], self.plant.truth(time_s)))

    def _source(self, index: int) -> Callable[[float], float]:
        return lambda now_s: self.plant.counts(self._time_s(now_s))[index] * (ADC_REFERENCE_V / ADC_COUNTS)


couple = TurntableCoupling

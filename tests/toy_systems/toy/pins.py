"""`toy` on the pins of the virtual board: volts into PA0."""

from __future__ import annotations

from plumb.systems.toy.scenarios import Plant

from plumb.f103.machine import Machine
from plumb.systems.analog_scans import AnalogScans
from plumb.systems.contracts import Conversion

SCENARIO = SHOWN = "jumps"
TUNING = "slow"
FRAMES = ("RAW_A", "RAW_B", "RAW_C", "RAW_D", "RAW_E", "TOY_LEVEL")
VOLTS_PER_COUNT = 3.3 / 4096


class ToyCoupling:
    """The plant's time 0 is the first sample. taken: the samples of PA0; the other scans of a period are none."""

    def __init__(self, machine: Machine, plant: Plant) -> None:
        self.taken: list[Conversion] = []
        self._plant = plant
        self._start_s: float | None = None
        self._scans = AnalogScans(plant.period_us, 0)
        machine.adc["PA0"] = lambda now_s: self._count(now_s) * VOLTS_PER_COUNT
        machine.adc.before_conversion["PA0"] = self._convert
        machine.adc["PA1"] = machine.adc["PA2"] = lambda _now_s: 1.65

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start_s is None else max(0.0, now_s - self._start_s)

    def _count(self, now_s: float) -> int:
        return int(self._plant.counts(self._time_s(now_s))[0])

    def _convert(self, now_s: float) -> None:
        if not self._scans.convert(now_s):
            return
        if self._start_s is None:
            self._start_s = now_s + self._scans.until_sample_s()
        if self._scans.is_sample:
            self.taken.append(Conversion(now_s, self._count(now_s), self._plant.truth(self._time_s(now_s))))


couple = ToyCoupling

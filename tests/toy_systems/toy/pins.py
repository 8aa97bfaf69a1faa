"""`toy` on the pins of the virtual board: volts into PA0."""

from __future__ import annotations

from plumb.systems.toy.scenarios import Plant

from plumb.f103.machine import Machine
from plumb.systems.analog_scans import SampledPlant

SCENARIO = SHOWN = "jumps"
TUNING = "slow"
FRAMES = ("RAW_A", "RAW_B", "RAW_C", "RAW_D", "RAW_E", "TOY_LEVEL")
VOLTS_PER_COUNT = 3.3 / 4096


class ToyCoupling(SampledPlant):
    """The plant's time 0 is the first sample. taken: the samples of PA0; the other scans of a period are none."""

    def __init__(self, machine: Machine, plant: Plant) -> None:
        super().__init__(plant, plant.period_us)
        machine.adc["PA0"] = lambda now_s: self.count(now_s) * VOLTS_PER_COUNT
        machine.adc.before_conversion["PA0"] = self.convert
        machine.adc["PA1"] = machine.adc["PA2"] = lambda _now_s: 1.65


couple = ToyCoupling

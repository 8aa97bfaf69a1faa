"""`current` on the pins of the virtual board: a winding that stands still between two phases of the bridge, and the
amplifier of its shunt at PA0."""

from __future__ import annotations

from plumb.systems.current.scenarios import Plant

from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.physics.motor import hall_state, share_of_supply
from plumb.systems.analog_scans import SampledPlant

SCENARIO = SHOWN = "steps"
TUNING = "plain"
FRAMES = ("RAW_A", "CURRENT_LOOP", "CURRENT_ERROR")
ADC_PINS = ("PA0",)
BREAK_PIN = "PB12"
FOLLOW_US = 1000
VOLTS_PER_COUNT = 3.3 / 4096


class CurrentCoupling(SampledPlant):
    """The plant's time 0 is the first sample. taken: the samples of PA0."""

    def __init__(self, machine: Machine, plant: Plant) -> None:
        self.machine, self.plant = machine, plant
        super().__init__(plant, plant.period_us)
        for pin in ("PA0", "PA1", "PA2"):  # an input that nothing is wired to would count as one that hangs
            machine.adc[pin] = self._volts
        machine.adc.before_conversion["PA0"] = self.convert
        machine.drive(BREAK_PIN, True)
        machine.set_hall(hall_state(0.0))
        self._follow(machine.now)

    def _volts(self, now_s: float) -> float:
        return self.count(now_s) * VOLTS_PER_COUNT

    def _follow(self, now: int) -> None:
        bridge = self.machine.bridge()
        share = share_of_supply(bridge.duty, 0.0) if bridge.enabled else 0.0
        self.plant.drive_to(self.time_s(now / TICKS_PER_S), share)
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)


couple = CurrentCoupling

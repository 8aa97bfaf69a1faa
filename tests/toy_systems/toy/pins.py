"""`toy` on the pins of the virtual board: volts into PA0."""

from __future__ import annotations

from plumb.systems.toy.scenarios import Plant

from plumb.f103.machine import Machine

SCENARIO = SHOWN = "jumps"
TUNING = "slow"
FRAMES = ("RAW_A", "TOY_LEVEL")
VOLTS_PER_COUNT = 3.3 / 4096


class Coupling:
    """The plant's time 0 is the first conversion."""

    def __init__(self, machine: Machine, plant: Plant) -> None:
        self.taken: list[tuple[int, dict[str, float]]] = []
        self._plant = plant
        self._start_s: float | None = None
        machine.adc["PA0"] = self._volts
        machine.adc["PA1"] = machine.adc["PA2"] = lambda _now_s: 1.65

    def _volts(self, now_s: float) -> float:
        self._start_s = now_s if self._start_s is None else self._start_s
        time_s = now_s - self._start_s
        count = self._plant.counts(time_s)[0]
        self.taken.append((count, self._plant.truth(time_s)))
        return (count + 0.5) * VOLTS_PER_COUNT

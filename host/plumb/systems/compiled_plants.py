"""The plant of a system in C, plant.c, which closes the loops of many runs without leaving C.

compiled_plant.py of a system gives a drawn run as the numbers and signals that its plant.c names. Both plants give the
same counts in every bit: the one in Python is what a simulated board is joined to, the one in C runs campaigns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from plumb.contract.scenario import Scenario
from plumb.physics.sensors import DIGITAL_FAULT_KINDS, Fault
from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part


@dataclass(frozen=True)
class DrawnRun:
    """numbers, signals: by name, in the order of plant.c. points: values of a signal on the grid of the physics."""

    numbers: Mapping[str, float]
    signals: Mapping[str, FloatArray]
    faults: Sequence[Fault]
    points: int

    def fault_rows(self) -> FloatArray:
        """Kind, channel, start and stop of every fault, (faults, 4)."""
        rows = [
            (DIGITAL_FAULT_KINDS.index(fault.kind), fault.channel, fault.start_s, fault.stop_s) for fault in self.faults
        ]
        return np.array(rows, np.float64).reshape(-1, 4)


class CompiledPlant(Protocol):
    """compiled_plant.py of a system."""

    @property
    def PRESCRIBES(self) -> bool:
        """Whether plant.c computes the prescribed motion of an open loop, too; else the scenario has it in arrays."""

    def drawn(self, scenario: Scenario, /, *, open_loop: bool) -> DrawnRun:
        """The run of a scenario. open_loop: the motion is prescribed."""


COMPILED = Part[CompiledPlant]("compiled_plant", CompiledPlant, without="its plant is in Python alone")

"""Measures of a run, declared by its system: its figures with their units, and which of them limits hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from plumb import systems
from plumb.spec.system_parts import Part


class Measure(NamedTuple):
    """A figure of a run. metric: its name in `metrics()`; unit: of its value; text: what it compares, and how. suits:
    a tuning beyond it is not made for the scenario, and gets no limit of its own."""

    metric: str
    unit: str
    text: str
    suits: float = math.inf

    @property
    def how(self) -> str:
        """How the value sums a run up, behind the unit: ` rms` of `..., rms`, else nothing."""
        return " rms" if self.text.endswith(", rms") else ""


class Measured(Protocol):
    """plots.py of a system: which figures its `metrics()` has in every run."""

    @property
    def MEASURES(self) -> Sequence[Measure]:
        """In the order in which a report shows them."""

    @property
    def MAIN(self) -> str:
        """The metric of MEASURES that says how far a run is from the truth, which limits hold; "" if there is none."""

    @property
    def APART(self) -> str:
        """The metric of MEASURES that compares integers and float64 on the same counts; "" if there is none."""


MEASURED = Part[Measured]("plots", Measured, place="judging")


def main_of(system: str) -> Measure | None:
    """The main figure of a system; None if it declares none."""
    declared = systems.load(system, MEASURED)
    return next((measure for measure in declared.MEASURES if measure.metric == declared.MAIN), None)

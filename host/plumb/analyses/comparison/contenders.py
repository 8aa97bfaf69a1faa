"""Every compared algorithm by one interface: those of PyPI, and the systems that have a compare.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.analyses.comparison.published import PUBLISHED, Published, imported
from plumb.analyses.comparison.samples import Samples, vertical_of
from plumb.spec import declarations
from plumb.spec.system_parts import Part
from plumb.tuning.quantise import ControlParams
from plumb.version import installed

FloatArray = npt.NDArray[np.float64]


class Compared(Protocol):
    """compare.py of a system: its estimate of the vertical from a three-axis gyro and accelerometer."""

    @property
    def TUNING_NAME(self) -> str:
        """The tuning that it runs with, one for every recording."""

    def params(self, samples: Samples, /) -> ControlParams:
        """The parameters of a run. The calibration is the sensor's nominal one (`samples.sensor`): errors of the sensor
        are the algorithm's to find. Raises UsageError for a period that the system cannot have."""

    def verticals(self, samples: Samples, /) -> FloatArray:
        """The vertical in sensor coordinates after each sample, (N, 3), from the C core with these parameters."""


COMPARE = Part[Compared]("compare", Compared, without="it is not compared with published algorithms", place="judging")


@dataclass(frozen=True)
class Contender:
    """An algorithm. origin: package and version; cost: cycles or operations of a sample, with the source."""

    name: str
    origin: str
    settings: str
    cost: str
    verticals: Callable[[Samples], FloatArray]


def contenders() -> tuple[Contender, ...]:
    """The published ones, then the systems. Raises UsageError where a package is not installed."""
    return (*map(_published, PUBLISHED), *map(_system, systems.with_part(COMPARE.name)))


def _published(one: Published) -> Contender:
    imported(one)
    return Contender(one.name, one.origin, one.settings, one.cost, lambda samples: vertical_of(one.run(samples)))


def _system(name: str) -> Contender:
    part, budget = systems.load(name, COMPARE), declarations.system(name).cycles
    cost = "no budget declared" if budget is None else f"at most {budget} cycles (plumb bench)"
    return Contender(name, f"plumb {installed().version}", f"tuning {part.TUNING_NAME}", cost, part.verticals)

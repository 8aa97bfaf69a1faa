"""Every compared algorithm by one interface: those of PyPI, and the systems that have a compare.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from plumb import systems
from plumb.analyses.comparison.published import PUBLISHED, Published, imported
from plumb.analyses.comparison.samples import Estimate, Samples, vertical_of
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.proof.runs import RunInputs
from plumb.spec import declarations
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning
from plumb.version import installed


class Compared(Protocol):
    """compare.py of a system: its estimate of the vertical from a three-axis gyro and accelerometer."""

    @property
    def TUNING_NAME(self) -> str:
        """The tuning that it runs with, one for every recording."""

    def params(self, samples: Samples, tuning: AnyTuning | None = None, /) -> ControlParams:
        """The parameters of a run with a tuning; None: its own. The calibration is the sensor's nominal one
        (`samples.sensor`): errors of the sensor are the algorithm's to find. Raises UsageError for a period that the
        system cannot have."""

    def inputs(self, samples: Samples, /) -> RunInputs:
        """The samples as inputs of a run, with the reference as its truth."""

    def estimate(self, samples: Samples, /) -> Estimate:
        """The estimate after each sample, from the C core with these parameters. A system that takes marks of missing
        samples runs on `samples.marked`, any other on `samples.counts`."""


COMPARE = Part[Compared]("compare", Compared, without="it is not compared with published algorithms", place="judging")


@dataclass(frozen=True)
class Described:
    """An algorithm. origin: package and version; cost: cycles or operations of a sample, with the source.
    bias_limit_dps: the largest gyro bias of an axis that it can learn, None where it has no such limit."""

    name: str
    origin: str
    settings: str
    cost: str
    bias_limit_dps: float | None


@dataclass(frozen=True)
class Contender(Described):
    """An algorithm that runs on samples."""

    estimate: Callable[[Samples], Estimate]


def contenders(only: Sequence[str] = ()) -> tuple[Contender, ...]:
    """The published ones, then the systems; only: their names, () for all. Raises UsageError for a name that no
    algorithm has, and where a package is not installed."""
    names = (*(one.name for one in PUBLISHED), *systems.with_part(COMPARE.name))
    for name in only:
        if name not in names:
            raise UsageError(f"there is no algorithm '{name}' to compare; there are {', '.join(names)}")
    chosen = [name for name in names if not only or name in only]
    published = {one.name: one for one in PUBLISHED}
    return tuple(_published(published[name]) if name in published else _system(name) for name in chosen)


def _published(one: Published) -> Contender:
    limit_dps = one.bias_limit_dps(imported(one))
    return Contender(
        one.name, one.origin, one.settings, one.cost, limit_dps, lambda samples: Estimate(vertical_of(one.run(samples)))
    )


def _system(name: str) -> Contender:
    part, budget = systems.load(name, COMPARE), declarations.system(name).cycles
    cost = "no budget declared" if budget is None else f"at most {budget} cycles (plumb bench)"
    return Contender(name, f"plumb {installed().version}", f"tuning {part.TUNING_NAME}", cost, None, part.estimate)

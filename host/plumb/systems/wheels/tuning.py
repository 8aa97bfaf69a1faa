"""The tuning of `wheels`, in engineering units. A command of 1 is the full duty of a motor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, ForOnePeriod, quantity
from plumb.systems.balancer.tuning import BalancerTuning
from plumb.systems.wheels.settings import Riding, Turning, Watching


@dataclass(frozen=True, kw_only=True)
class WheelsTuning(ForOnePeriod):
    """The settings of a run of `wheels`; system.toml declares its own groups. balance: its edges are counts of both
    encoders together; its own period is not used."""

    system: ClassVar[str] = "wheels"

    period_us: int
    balance: BalancerTuning = field(metadata=quantity(NUMBER, "balance"))
    turning: Turning = field(metadata=quantity(NUMBER, "turning"))
    riding: Riding = field(default_factory=Riding)
    watching: Watching = field(default_factory=Watching)
    exact_period_s: float | None = None

"""The tuning of `balancer`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import AxisTuning
from plumb.systems.balancer.settings import Drive, SpeedLoop, Wheel

SPEED_MOST_MPS = 15.0
"""Speed that edges_max edges in a period may stand for."""
EDGES_MOST = (1 << 15) - 1


def most_edges(wheel: Wheel, period_s: float) -> int:
    """edges_max, or what it stands for at this period: as many as SPEED_MOST_MPS are."""
    if wheel.edges_max:
        return wheel.edges_max
    return int(min(SPEED_MOST_MPS * period_s / abs(wheel.edge_m), EDGES_MOST)) if wheel.edge_m else EDGES_MOST


@dataclass(frozen=True, kw_only=True)
class BalancerTuning(AxisTuning):
    """The settings of a run of `balancer`; system.toml declares its own groups. calibration.accel is the forward axis,
    with the sign that gives sin(tilt) at rest."""

    system: ClassVar[str] = "balancer"

    wheel: Wheel
    speed: SpeedLoop = field(default_factory=SpeedLoop)
    drive: Drive = field(default_factory=Drive)

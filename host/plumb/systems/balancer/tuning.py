"""The tuning of `balancer`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import AxisTuning


@dataclass(frozen=True)
class Wheel:
    """Hall edges to speed: way of the axle per edge, and the filter of the speed. accel_share: how much of its slope is
    taken off the forward axis before the arctangent; 0 is the source's. More than edges_max edges in a period are
    clamped, and counted.
    """

    edge_m: float
    edges_max: int
    tau_s: float = 0.2
    accel_share: float = 1.0


@dataclass(frozen=True)
class SpeedLoop:
    """The lean asked for by velocity error: proportional, integral (deg per m of way), against the axle's acceleration.

    Leans up to lean_max_deg and changes by up to lean_slew_dps; asked for at most speed_max_mps.
    """

    lean_deg_per_mps: float = 0.0
    lean_deg_per_m: float = 0.0
    lean_deg_per_g: float = 0.0
    accel_tau_s: float = 0.0
    lean_max_deg: float = 8.0
    lean_slew_dps: float = 1e4
    speed_max_mps: float = 1.0


@dataclass(frozen=True)
class Drive:
    """Duty of the bridge from the command, -1..1: span, with the sign that a positive command makes the tilt grow, and
    so drives backwards; beyond fall_deg the bridge stays at 0 until the run ends.
    """

    span: float = -32767 / 32768
    duty_max: float = 32767 / 32768
    fall_deg: float = 45.0


@dataclass(frozen=True, kw_only=True)
class BalancerTuning(AxisTuning):
    """Everything one run of `balancer` needs.

    calibration.accel is the forward axis, its sign such that it reads sin(tilt) at rest.
    """

    system: ClassVar[str] = "balancer"

    wheel: Wheel
    speed: SpeedLoop = field(default_factory=SpeedLoop)
    drive: Drive = field(default_factory=Drive)

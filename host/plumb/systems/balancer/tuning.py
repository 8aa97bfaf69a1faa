"""The tuning of `balancer`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import AxisTuning


@dataclass(frozen=True)
class Wheel:
    """Conversion of Hall edges to speed: distance of the axle per edge, and the filter of the speed.

    accel_share: fraction of the speed's slope that is subtracted from the forward axis before the arctangent; 0 as in
    the source. More than edges_max edges in a period are clamped and counted.
    """

    edge_m: float
    edges_max: int
    tau_s: float = 0.2
    accel_share: float = 1.0


@dataclass(frozen=True)
class SpeedLoop:
    """Lean setpoint from the velocity error: proportional and integral (deg per m), damped by the axle's acceleration.

    The lean is limited to lean_max_deg and its rate to lean_slew_dps; the velocity setpoint is limited to
    speed_max_mps.
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
    """Duty of the bridge, -1..1, from the command: span is the duty at command 1. Its sign is such that a positive
    command increases the tilt, i.e. drives backwards. Beyond fall_deg the duty stays 0 until the run ends.
    """

    span: float = -32767 / 32768
    duty_max: float = 32767 / 32768
    fall_deg: float = 45.0


@dataclass(frozen=True, kw_only=True)
class BalancerTuning(AxisTuning):
    """The settings of a run of `balancer`. calibration.accel is the forward axis, with the sign that gives sin(tilt) at
    rest."""

    system: ClassVar[str] = "balancer"

    wheel: Wheel
    speed: SpeedLoop = field(default_factory=SpeedLoop)
    drive: Drive = field(default_factory=Drive)

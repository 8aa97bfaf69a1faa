"""The tuning of `balancer`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, AxisTuning, quantity

SPEED_MOST_MPS = 15.0
"""Speed that edges_max edges in a period may stand for."""
EDGES_MOST = (1 << 15) - 1


@dataclass(frozen=True)
class Wheel:
    """Conversion of Hall edges to speed: distance of the axle per edge, and the filter of the speed.

    accel_share: fraction of the speed's slope that is subtracted from the forward axis before the arctangent; 0 as in
    the source. More than edges_max edges in a period are clamped and counted.
    """

    edge_m: float = field(metadata=quantity("m", "distance of the axle per edge of the Hall sensors"))
    edges_max: int = field(
        default=0,
        metadata=quantity(
            "edge", "most edges in a period, more are clamped and counted; 0: as many as 15 m/s are at its period"
        ),
    )
    tau_s: float = field(default=0.2, metadata=quantity("s", "time constant of the speed's low-pass; 0 is none"))
    accel_share: float = field(
        default=1.0,
        metadata=quantity(
            NUMBER, "share of the speed's slope that is taken off the forward axis before the arctangent"
        ),
    )

    def most_edges(self, period_s: float) -> int:
        """edges_max, or what it stands for at this period: as many as SPEED_MOST_MPS are."""
        if self.edges_max:
            return self.edges_max
        return int(min(SPEED_MOST_MPS * period_s / abs(self.edge_m), EDGES_MOST)) if self.edge_m else EDGES_MOST


@dataclass(frozen=True)
class SpeedLoop:
    """Lean setpoint from the velocity error: proportional and integral (deg per m), damped by the axle's acceleration.

    The lean is limited to lean_max_deg and its rate to lean_slew_dps; the velocity setpoint is limited to
    speed_max_mps.
    """

    lean_deg_per_mps: float = field(
        default=0.0, metadata=quantity("deg/(m/s)", "proportional gain: lean per m/s of velocity error")
    )
    lean_deg_per_m: float = field(
        default=0.0, metadata=quantity("deg/m", "integral gain: lean per m/s of velocity error and second")
    )
    lean_deg_per_g: float = field(
        default=0.0, metadata=quantity("deg/g", "damping: lean per g of the axle's acceleration")
    )
    accel_tau_s: float = field(
        default=0.0, metadata=quantity("s", "time constant of the acceleration's low-pass in the damping; 0 is none")
    )
    lean_max_deg: float = field(default=8.0, metadata=quantity("deg", "largest lean"))
    lean_slew_dps: float = field(default=1e4, metadata=quantity("deg/s", "largest rate of the lean"))
    speed_max_mps: float = field(default=1.0, metadata=quantity("m/s", "largest velocity setpoint"))


@dataclass(frozen=True)
class Drive:
    """Duty of the bridge, -1..1, from the command: span is the duty at command 1. Its sign is such that a positive
    command increases the tilt, i.e. drives backwards. Beyond fall_deg the duty stays 0 until the run ends.
    """

    span: float = field(
        default=-32767 / 32768,
        metadata=quantity(NUMBER, "duty of the bridge at command 1; its sign turns the direction"),
    )
    duty_max: float = field(default=32767 / 32768, metadata=quantity(NUMBER, "largest duty of the bridge"))
    fall_deg: float = field(
        default=45.0, metadata=quantity("deg", "tilt beyond which the duty stays 0 until the run ends")
    )


@dataclass(frozen=True, kw_only=True)
class BalancerTuning(AxisTuning):
    """The settings of a run of `balancer`. calibration.accel is the forward axis, with the sign that gives sin(tilt) at
    rest."""

    system: ClassVar[str] = "balancer"

    wheel: Wheel
    speed: SpeedLoop = field(default_factory=SpeedLoop)
    drive: Drive = field(default_factory=Drive)

"""Ground under a body on four legs: a plane that may slope, springs and dampers in the legs, dry friction.

Assumed: legs that give way by 3 mm under 0.7 kg (600 N/m each, 8 N s/m) and a friction of 0.8, which is
proportional to the speed below 2 cm/s.
"""

from __future__ import annotations

import numpy as np

from plumb.physics.airframe import Airframe
from plumb.spec.arrays import BoolArray, FloatArray

SPRING_NPM, DAMPER_NSPM = 600.0, 8.0
FRICTION, CREEP_MPS = 0.8, 0.02


class Ground:
    """The plane through the origin that rises by slope_rad towards +x."""

    def __init__(self, frame: Airframe, slope_rad: float = 0.0) -> None:
        self.normal = np.array([-np.sin(slope_rad), 0.0, np.cos(slope_rad)])
        out, down = frame.leg_out_m, frame.leg_down_m
        self._legs = np.array([[out, out, -down], [-out, out, -down], [-out, -out, -down], [out, -out, -down]]).T
        self._reach_m = float(np.linalg.norm(self._legs[:, 0]))

    def contact(
        self, position_m: FloatArray, velocity_mps: FloatArray, matrix: FloatArray, rate_radps: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Force in earth axes, N, and torque in body axes, N m, (3, runs) each."""
        height = self.normal @ position_m
        zero = np.zeros_like(position_m)
        if not (height < self._reach_m).any():
            return zero, zero
        force, torque = np.zeros_like(position_m), np.zeros_like(position_m)
        for leg in self._legs.T:
            arm = np.broadcast_to(leg[:, None], position_m.shape)
            moved = velocity_mps + (matrix * np.cross(rate_radps, arm, axis=0)).sum(axis=1)
            depth = -(height + self.normal @ (matrix * arm).sum(axis=1))
            rising = self.normal @ moved
            pressed = np.where(depth > 0.0, np.maximum(SPRING_NPM * depth - DAMPER_NSPM * rising, 0.0), 0.0)
            along = moved - self.normal[:, None] * rising
            slid = np.sqrt((along * along).sum(axis=0))
            pushed = self.normal[:, None] * pressed - FRICTION * pressed * along / np.maximum(slid, CREEP_MPS)
            force += pushed
            torque += np.cross(arm, (matrix * pushed[:, None]).sum(axis=0), axis=0)
        return force, torque

    def touched(self, position_m: FloatArray, margin_m: float) -> BoolArray:
        """True where the height of the centre above the plane is less than that of a body on its legs plus a margin."""
        return np.asarray(self.normal @ position_m < -self._legs[2, 0] + margin_m)

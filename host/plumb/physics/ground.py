"""Ground under a body on four legs: a plane that may slope, springs and dampers in the legs, dry friction.

Assumed: a friction of 0.8, which is proportional to the speed below 2 cm/s. The springs and dampers of the legs are the
frame's.
"""

from __future__ import annotations

import numpy as np

from plumb.physics.airframe import Airframe
from plumb.physics.vectors import cross, length, to_body, to_earth, total
from plumb.spec.arrays import BoolArray, FloatArray

FRICTION, CREEP_MPS = 0.8, 0.02


class Ground:
    """The plane through the origin that rises by slope_rad towards +x."""

    def __init__(self, frame: Airframe, slope_rad: float = 0.0) -> None:
        self.normal = np.array([-np.sin(slope_rad), 0.0, np.cos(slope_rad)])
        self.slope_rad, self.frame = slope_rad, frame
        out, down = frame.leg_out_m, frame.leg_down_m
        self.legs = np.array([[out, out, -down], [-out, out, -down], [-out, -out, -down], [out, -out, -down]]).T
        self.reach_m = float(np.linalg.norm(self.legs[:, 0]))

    def standing(self, heading_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Attitudes (4, runs) and places (3, runs) of bodies that stand on it with these headings, (runs,)."""
        half, lean = heading_rad / 2.0, -self.slope_rad / 2.0
        # Heading about the vertical, then the slope's lean about the earth's y axis.
        w, z = np.cos(half), np.sin(half)
        attitude = np.stack([np.cos(lean) * w, np.sin(lean) * z, np.sin(lean) * w, np.cos(lean) * z])
        place = np.broadcast_to((self.frame.leg_down_m * self.normal)[:, None], (3, len(heading_rad))).copy()
        return attitude, place

    def above_m(self, position_m: FloatArray) -> FloatArray:
        """Height of the centres above the plane, (runs,)."""
        return total(self.normal[:, None] * position_m)

    def contact(
        self, position_m: FloatArray, velocity_mps: FloatArray, matrix: FloatArray, rate_radps: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Force in earth axes, N, and torque in body axes, N m, (3, runs) each."""
        height = self.above_m(position_m)
        zero = np.zeros_like(position_m)
        if not (height < self.reach_m).any():
            return zero, zero
        force, torque, normal = np.zeros_like(position_m), np.zeros_like(position_m), self.normal[:, None]
        for leg in self.legs.T:
            arm = np.broadcast_to(leg[:, None], position_m.shape)
            moved = velocity_mps + to_earth(matrix, cross(rate_radps, arm))
            depth = -(height + total(normal * to_earth(matrix, arm)))
            rising = total(normal * moved)
            pressing = self.frame.leg_spring_npm * depth - self.frame.leg_damper_nspm * rising
            pressed = np.where(depth > 0.0, np.maximum(pressing, 0.0), 0.0)
            along = moved - normal * rising
            pushed = normal * pressed - FRICTION * pressed * along / np.maximum(length(along), CREEP_MPS)
            force += pushed
            torque += cross(arm, to_body(matrix, pushed))
        return force, torque

    def touched(self, position_m: FloatArray, margin_m: float) -> BoolArray:
        """True where the height of the centre above the plane is less than that of a body on its legs plus a margin."""
        return np.asarray(self.above_m(position_m) < self.frame.leg_down_m + margin_m)

"""Poses in which `wheels` is calibrated, those of `balancer`, and the vehicle in a hand that stands in for it.

The zero of the gyro about the axle is that of the upward one, too: one group of parameters calibrates both. What is
left of the upward one the step learns from the wheels.
"""

from __future__ import annotations

import math
from dataclasses import replace

from plumb.physics.hand import TiltingHand
from plumb.systems.balancer.poses import POSES, TILTS_DEG, TURN
from plumb.systems.contracts import Held
from plumb.systems.wheels.plant import Duties, WheelsPlant
from plumb.systems.wheels.scenarios import scenario

__all__ = ["POSES", "TURN", "held"]


class HeldVehicle(WheelsPlant):
    """The vehicle with its sensors, held by a hand; the wheels stand."""

    def __init__(self, hand: TiltingHand, seed: int) -> None:
        drawn = scenario("level", seed)
        super().__init__(replace(drawn, vibration_g=0.0 * drawn.vibration_g))
        self._by_hand = hand
        self.drive_to(0.0, (None, None))

    def drive_to(self, time_s: float, duties: Duties) -> None:
        tilt_deg, rate_dps = self._by_hand.at(time_s)
        self.vehicle.tilt_rad, self.vehicle.rate_radps = math.radians(tilt_deg), math.radians(rate_dps)


def held(seed: int) -> Held:
    """The plant for the pins of the virtual board, and the hand."""
    hand = TiltingHand(TILTS_DEG)
    return Held(HeldVehicle(hand, seed), hand)

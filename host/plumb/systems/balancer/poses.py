"""Poses in which a `balancer` is calibrated, and the vehicle in a hand that stands in for it."""

from __future__ import annotations

import math
from dataclasses import replace

from plumb.physics.hand import TiltingHand
from plumb.systems.balancer.plant import BalancerPlant
from plumb.systems.balancer.scenarios import scenario
from plumb.systems.contracts import Held
from plumb.tuning.pose_calibration import Pose, Turn

POSES = (
    Pose("upright", "hold it upright, as it is to drive, against a wall", {"accel": 0.0, "accel_up": 1.0}),
    Pose("on its front", "lay it on its front, tilted forward by 90 degrees", {"accel": 1.0, "accel_up": 0.0}),
    Pose("upside down", "stand it on its head", {"accel": 0.0, "accel_up": -1.0}),
    Pose("on its back", "lay it on its back, tilted backward by 90 degrees", {"accel": -1.0, "accel_up": 0.0}),
)
TILTS_DEG = {"upright": 0.0, "on its front": 90.0, "upside down": 180.0, "on its back": 270.0}
TURN = Turn("tilt it forward, from upright to its front", "upright", "on its front", "gyro", "accel", "accel_up")


class HeldVehicle(BalancerPlant):
    """The vehicle with its sensors, held by a hand; the wheels stand."""

    def __init__(self, hand: TiltingHand, seed: int) -> None:
        drawn = scenario("rough", seed)
        super().__init__(replace(drawn, vibration_g=0.0 * drawn.vibration_g), open_loop=True)
        self._by_hand = hand
        self.drive_to(0.0, None)

    def drive_to(self, time_s: float, duty: float | None) -> None:
        tilt_deg, rate_dps = self._by_hand.at(time_s)
        vehicle = self.vehicle
        vehicle.tilt_rad, vehicle.rate_radps = math.radians(tilt_deg), math.radians(rate_dps)
        vehicle.velocity_mps = vehicle.accel_mps2 = vehicle.turning_radps2 = 0.0


def held(seed: int) -> Held:
    """The plant for the pins of the virtual board, and the hand."""
    hand = TiltingHand(TILTS_DEG)
    return Held(HeldVehicle(hand, seed), hand)

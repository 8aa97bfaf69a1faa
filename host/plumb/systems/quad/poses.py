"""Poses in which a `quad` is calibrated, and the axis in a hand that stands in for it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from plumb.physics.hand import TiltingHand
from plumb.systems.contracts import Held
from plumb.systems.quad.plant import QuadPlant
from plumb.systems.quad.scenarios import HOLD_PERIOD_US, scenario
from plumb.tuning.pose_calibration import Pose, Turn

POSES = (
    Pose("level", "hold the arm level, as it is to fly, on a firm surface", {"accel": 0.0, "accel_up": 1.0}),
    Pose("motor 0 up", "stand it on its side, motor 0 (PB6) straight up", {"accel": 1.0, "accel_up": 0.0}),
    Pose("upside down", "lay it upside down", {"accel": 0.0, "accel_up": -1.0}),
    Pose("motor 1 up", "stand it on its other side, motor 1 (PB7) straight up", {"accel": -1.0, "accel_up": 0.0}),
)
_TILTS_DEG = {"level": 0.0, "motor 0 up": 90.0, "upside down": 180.0, "motor 1 up": 270.0}
TURN = Turn(
    "tilt it so that motor 0 (PB6) goes up, from level to its side", "level", "motor 0 up", "gyro", "accel", "accel_up"
)


class HeldAxis(QuadPlant):
    """The axis with its sensors, held by a hand; the motors move nothing."""

    def __init__(self, hand: TiltingHand, seed: int) -> None:
        super().__init__(scenario("quiet", seed, period_us=HOLD_PERIOD_US), open_loop=True)
        self._by_hand = hand
        self.advance_to(0.0, ())

    def advance_to(self, time_s: float, pulse_us: Sequence[float]) -> None:
        self.tilt_deg, self.rate_dps = self._by_hand.at(time_s)
        tilt_rad = math.radians(self.tilt_deg)
        self._force_filtered = math.sin(tilt_rad), math.cos(tilt_rad)


def held(seed: int) -> Held:
    """The plant for the pins of the virtual board, and the hand."""
    hand = TiltingHand(_TILTS_DEG)
    return Held(HeldAxis(hand, seed), hand)

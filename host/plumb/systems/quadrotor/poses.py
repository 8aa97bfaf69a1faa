"""Poses and turns in which a `quadrotor` is calibrated: those of `attitude`, for a frame without propellers.

The arms of an X point between the axes; x is to the front, between the rotors 0 and 1.

          1  front  0                  The frame lies flat, seen from above.
           \\  ^ x  /                   level: as drawn, z points at you.
             \\|/                      left side up: rotors 1 and 2 up, 0 and 3 on the ground.
      left  y <-+    right             front up: rotors 0 and 1 up, 2 and 3 on the ground.
             / z \\
           2       3
"""

from __future__ import annotations

from plumb.physics.hand import TurningHand
from plumb.systems.attitude.held import HeldBody
from plumb.systems.attitude.poses import ACCEL, GYRO, POSES, TURNS, sensors_of, words_of
from plumb.systems.attitude.scenarios import ONE_CHIP
from plumb.systems.contracts import Held
from plumb.tuning.vector_calibration import up

__all__ = ["ACCEL", "GYRO", "PICTURE", "POSES", "TURNS", "held", "sensors_of", "words_of"]

PICTURE = __doc__.partition("\n\n")[2] if __doc__ else ""
"""The axes of the body, before the first pose."""


def held(seed: int) -> Held:
    """The plant for the pins of the virtual board, and the hand."""
    hand = TurningHand({pose.name: up(pose).tolist() for pose in POSES})
    return Held(HeldBody(hand, seed, part=ONE_CHIP), hand)

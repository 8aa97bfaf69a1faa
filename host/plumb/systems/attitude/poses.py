"""Poses and turns in which an `attitude` is calibrated, and the body in a hand that stands in for it.

Draw an arrow on the body: it points to the front. x is to the front, y to the left, z up.

              front                    The body lies flat, seen from above.
                ^ x                    level: as drawn, z points at you.
                |                      left side up: stand it on its right side; front stays where it is.
      left  y <-+    right             front up: stand it on its back end, the arrow points at the ceiling.
               z
              back
"""

from __future__ import annotations

from collections.abc import Mapping

from plumb.physics.hand import TurningHand
from plumb.systems.attitude.held import HeldBody
from plumb.systems.contracts import Held
from plumb.tuning import mounting
from plumb.tuning.groups import channel_words
from plumb.tuning.pose_calibration import WORDS_PER_UNIT, BodyTurn, Pose, channels_of
from plumb.tuning.vector_calibration import Sensor, up

GYRO = ("gyro_x", "gyro_y", "gyro_z")
ACCEL = ("accel_x", "accel_y", "accel_z")
UNITS = {"gyro": "turn/s", "accel": "g"}
POSES = (
    Pose("level", "lay it flat, as it is used, on a level surface", {"x": 0.0, "y": 0.0, "z": 1.0}),
    Pose("upside down", "turn it right over, onto its top", {"x": 0.0, "y": 0.0, "z": -1.0}),
    Pose("left side up", "stand it on its right side, left side up", {"x": 0.0, "y": 1.0, "z": 0.0}),
    Pose("right side up", "stand it on its left side, right side up", {"x": 0.0, "y": -1.0, "z": 0.0}),
    Pose("front up", "stand it on its back end, front up", {"x": 1.0, "y": 0.0, "z": 0.0}),
    Pose("front down", "stand it on its front end, front down", {"x": -1.0, "y": 0.0, "z": 0.0}),
)
TURNS = (
    BodyTurn("from level, raise the left side until it stands on its right side", "level", "left side up"),
    BodyTurn("its front swings up, until it stands on its back end", "left side up", "front up"),
    BodyTurn("its front swings down, until it lies level", "front up", "level"),
)
PICTURE = __doc__.partition("\n\n")[2] if __doc__ else ""
"""The axes of the body, before the first pose."""


def sensors_of(table: Mapping[str, int]) -> tuple[Sensor, Sensor]:
    """Gyro and accelerometer of a table of parameters."""
    channels = channels_of(table, UNITS)
    gyro, accel = (
        Sensor(channels[group], mounting.matrix_of(dict(table), f"{group}_mounting")) for group in ("gyro", "accel")
    )
    return gyro, accel


def words_of(gyro: Sensor, accel: Sensor) -> dict[str, int]:
    """Parameters of these sensors. Raises UsageError for what their integers cannot hold."""
    words: dict[str, int] = {}
    for group, sensor in (("gyro", gyro), ("accel", accel)):
        words |= channel_words(group, sensor.channel, WORDS_PER_UNIT[UNITS[group]])
        words |= mounting.mounting_words(f"{group}_mounting", sensor.matrix)
    turned = any(mounting.is_turned(mounting.matrix_of(words, f"{group}_mounting")) for group in UNITS)
    return {**words, "attitude.mounted": int(turned)}


def held(seed: int) -> Held:
    """The plant for the pins of the virtual board, and the hand."""
    hand = TurningHand({pose.name: up(pose).tolist() for pose in POSES})
    return Held(HeldBody(hand, seed), hand)

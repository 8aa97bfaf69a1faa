"""A second frame for `quadrotor`: PX4's iris, twice as heavy, reported with the hummingbird.

Its gains are those of the rule (`plumb.systems.quadrotor.frame_tuning`), its numbers those of `plumb.physics.airframe`.
"""

from __future__ import annotations

from plumb.physics.airframe import IRIS_X
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.frame_tuning import tuned
from plumb.systems.quadrotor.tuning import QuadrotorTuning

NAME = "iris"


def tuning() -> QuadrotorTuning:
    """The shipped one with gains and drag of this frame."""
    return tuned(quadrotor.HUMMINGBIRD, IRIS_X)

"""Which side of a three-axis sensor points up, and whether that can be the pose that was asked for.

How the sensor is mounted is not known yet. What can be said: one axis of it points up or down; opposite poses turn the
same axis round; three pairs take three axes; and the third pair follows from two, because no rotation mirrors a sensor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel
from plumb.tuning.pose_calibration import COARSE_G, DRIFTED_G, MOVED_DPS, MOVED_G, Pose

COMPLETE = 0.98
"""Share of the samples that have to arrive."""
AXES = "xyz"
NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}
"""Axis -> the two whose cross product it is."""


@dataclass(frozen=True)
class VectorReading:
    """Raw counts of both sensors, (samples, 3) each. expected: samples that the board took, in so many seconds."""

    gyro: FloatArray
    accel: FloatArray
    expected: int
    seconds: float

    @property
    def samples(self) -> int:
        return min(len(self.gyro), len(self.accel))

    @property
    def complete(self) -> bool:
        return self.samples > 1 and self.samples >= COMPLETE * self.expected


def refusal(
    pose: Pose, reading: VectorReading, gyro: Channel, accel: Channel, earlier: Mapping[str, tuple[Pose, FloatArray]]
) -> str | None:
    """Why the reading cannot be of this pose, in a sentence that says what to do; None where it may be. earlier: the
    readings taken so far, as `felt_g`."""
    return unusable(reading, gyro, accel) or _not_the_pose(pose, felt_g(reading, accel), earlier)


def unusable(reading: VectorReading, gyro: Channel, accel: Channel) -> str | None:
    """Why a reading says nothing of any pose: samples are missing, clipped, or it moved."""
    if not reading.complete:
        return f"only {reading.samples} of {reading.expected} samples came: check the sensor's wires and the link"
    for name, counts, channel in (("gyro", reading.gyro, gyro), ("accelerometer", reading.accel, accel)):
        at_limit = np.any((counts <= channel.min_counts) | (counts >= channel.max_counts), axis=0)
        if np.any(at_limit):
            axes = ", ".join(axis for axis, at in zip(AXES, at_limit, strict=True) if at)
            return f"the {name} is at its limit (axis {axes}): keep it at rest, and check its wire and its range"
    if np.max(reading.gyro.std(axis=0)) * abs(gyro.unit_per_count) > MOVED_DPS:
        return "the gyro felt a motion: put it down, let go, and wait"
    half = len(reading.accel) // 2
    drift = reading.accel[half:].mean(axis=0) - reading.accel[:half].mean(axis=0)
    scale = abs(accel.unit_per_count)
    if np.max(reading.accel.std(axis=0)) * scale > MOVED_G or np.max(np.abs(drift)) * scale > DRIFTED_G:
        return "the accelerometer felt a motion: put it down, let go, and wait"
    return None


def felt_g(reading: VectorReading, accel: Channel) -> FloatArray:
    """Mean acceleration in the sensor's axes, by the data sheet."""
    return np.asarray((reading.accel.mean(axis=0) - accel.zero_counts) * accel.unit_per_count)


def side(felt: FloatArray) -> FloatArray | None:
    """The sensor's axis that points up, as a vector of 0 and +-1; None where it is between two."""
    up = np.zeros(3)
    axis = int(np.argmax(np.abs(felt)))
    up[axis] = np.sign(felt[axis])
    return up if np.max(np.abs(felt - up)) <= COARSE_G else None


def _not_the_pose(pose: Pose, felt: FloatArray, earlier: Mapping[str, tuple[Pose, FloatArray]]) -> str | None:
    """That another side is up than in this pose, as far as the earlier ones say which that is."""
    reads = ", ".join(f"{axis} {one:+z.2f}" for axis, one in zip(AXES, felt, strict=True))
    up = side(felt)
    if up is None:
        return f"no side is up: the sensor reads {reads} g; stand it straight, leaned against something square"
    known: dict[str, FloatArray] = {}
    for other, before in earlier.values():
        if other.name == pose.name or (found := side(before)) is None:
            continue
        if np.array_equal(up, found):
            return f"it reads the same as in the pose '{other.name}' ({reads} g): another side has to be up"
        if other.axis == pose.axis and not np.array_equal(up, -found):
            return f"it is not the opposite of the pose '{other.name}': the sensor reads {reads} g; turn it right over"
        if other.axis != pose.axis and np.array_equal(up, -found):
            return f"it is the opposite of the pose '{other.name}' ({reads} g): another side has to be up"
        known[other.axis] = found * other.up_g[other.axis]
    return _mirrored(pose, up, known)


def _mirrored(pose: Pose, up: FloatArray, known: Mapping[str, FloatArray]) -> str | None:
    """That this side would make a mirror image of the sensor, from where the two other axes of the body are."""
    first, second = NEXT[pose.axis]
    if first not in known or second not in known:
        return None
    if np.array_equal(up * pose.up_g[pose.axis], np.cross(known[first], known[second])):
        return None
    return (
        "it is the other way up, or a side before was taken for its opposite: turn it over; if it is right as it is, "
        "begin again, and mind what is left and right, front and back"
    )

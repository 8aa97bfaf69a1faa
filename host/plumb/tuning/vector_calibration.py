"""Calibrate a three-axis accelerometer and gyro from six poses at rest and three turns.

Every axis of the body points up in one pose and down in another. The six readings give where the body's axes are in the
sensor's, so that the sensor may be mounted in any of the 24 ways, and a few degrees off. The length of a sensor axis
over the three pairs is its scale, and the middle of the pair that it points along its zero: the errors of both grow
with the square of a pose's error. What remains is that axes are not quite square. A crooked pose looks the same, so it
is taken as far as the poses agree with each other, against what a data sheet allows.

A turn leads from one pose to another. The gyro's map is the axis that felt it; its scales are those that carry the
vertical of the pose before to that of the pose after, sample by sample. The turns do not show the whole matrix: what
they leave open stays as the accelerometer's, within what a data sheet allows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plumb.errors import UsageError
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import Channel
from plumb.tuning.pose_calibration import SCALE, Pose

SQUARE_RAD = 0.01
"""Standard deviation of an angle by which two axes of an accelerometer are not square: data sheets say 1 to 2 %."""
GYRO_SCALE, GYRO_RAD, VERTICAL_RAD = 0.03, 0.02, 0.01
"""Standard deviations of a gyro's scale and of an axis' direction, and of a vertical that a turn leads to."""
ITERATIONS = 4


@dataclass(frozen=True)
class Sensor:
    """What the board knows of a sensor: one channel for all three axes, and the matrix from its axes to the body's."""

    channel: Channel
    matrix: FloatArray

    def value(self, counts: FloatArray) -> FloatArray:
        """Values in body axes, (..., 3), in deg/s or g."""
        return np.asarray(((counts - self.channel.zero_counts) * self.channel.unit_per_count) @ self.matrix.T)


@dataclass(frozen=True)
class Fit:
    """What the readings say of a sensor: zeros in counts and units per count of its axes, and the matrix from its axes
    to the body's. held_rad: standard deviation of the poses, by how far opposite ones are from opposite."""

    zeros: FloatArray
    units: FloatArray
    matrix: FloatArray
    held_rad: float = 0.0

    def value(self, counts: FloatArray) -> FloatArray:
        """As Sensor.value, with a zero of every axis."""
        return np.asarray(((counts - self.zeros) * self.units) @ self.matrix.T)

    def sensor(self, channel: Channel) -> Sensor:
        """As near as one channel for all axes comes: the mean of the zeros, and the scales in the matrix."""
        zero = float(np.sum(self.zeros * self.units) / np.sum(self.units))
        common = Channel(zero, channel.unit_per_count, channel.min_counts, channel.max_counts)
        return Sensor(common, self.matrix * (self.units / channel.unit_per_count))

    def left(self, sensor: Sensor) -> FloatArray:
        """What one zero for all axes leaves of the zeros, in body axes, (3,)."""
        return sensor.value(self.zeros)


def up(pose: Pose) -> FloatArray:
    """The vertical of a pose in body axes."""
    return np.array([pose.up_g[axis] for axis in "xyz"], np.float64)


def nearest_map(matrix: FloatArray) -> FloatArray | None:
    """The axis map that is nearest to a matrix; None where two rows would take the same axis."""
    found = np.zeros((3, 3))
    for row, entries in enumerate(matrix):
        column = int(np.argmax(np.abs(entries)))
        found[row, column] = np.sign(entries[column])
    return found if np.all(np.abs(found).sum(axis=0) == 1.0) else None


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation, or reflection, that is nearest to a matrix."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)


def accelerometer(poses: Sequence[Pose], means: Mapping[str, FloatArray], channel: Channel) -> Fit:
    """The accelerometer from the mean counts of all poses. Raises UsageError for a scale that no such sensor has."""
    pairs = [_pair(poses, means, axis) for axis in "xyz"]
    per_g = np.stack([(high - low) / 2.0 for high, low in pairs], axis=1)  # counts of each sensor axis, body axis
    middles = np.stack([(high + low) / 2.0 for high, low in pairs], axis=1)
    sensitivity = np.linalg.norm(per_g, axis=1)
    weights = (per_g / sensitivity[:, None]) ** 2
    zeros = np.sum(weights * middles, axis=1)
    for name, ratio in zip("xyz", 1.0 / (sensitivity * abs(channel.unit_per_count)), strict=True):
        _require_scale(f"accelerometer, axis {name}", ratio)
    directions = per_g / sensitivity[:, None]
    across = (middles - zeros[:, None]) / sensitivity[:, None] * np.sqrt(1.0 - weights)
    held_rad = float(np.sqrt(2.0 * np.sum(across**2) / 6.0))
    exact = np.linalg.inv(directions)
    rotation = nearest_rotation(exact)
    bent = rotation.T @ exact - np.eye(3)
    square = ~np.eye(3, dtype=bool)
    bent[square] *= SQUARE_RAD**2 / (SQUARE_RAD**2 + held_rad**2 / 4.0)
    sign = np.sign(channel.unit_per_count)
    return Fit(zeros, sign / sensitivity, sign * rotation @ (np.eye(3) + bent), held_rad)


def _pair(poses: Sequence[Pose], means: Mapping[str, FloatArray], axis: str) -> tuple[FloatArray, FloatArray]:
    """Mean counts with this body axis up, and down."""
    high, low = (next(pose for pose in poses if pose.axis == axis and pose.up_g[axis] * sign > 0) for sign in (1, -1))
    return means[high.name], means[low.name]


def _require_scale(what: str, ratio: float) -> None:
    if not SCALE[0] <= ratio <= SCALE[1]:
        raise UsageError(
            f"{what}: a count is {ratio:.2f} times what the parameters say, and a part of this kind is within "
            f"{SCALE[0]:g} to {SCALE[1]:g}: choose the tuning for this sensor, or check its range, then begin again"
        )


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Angle between two vectors of any length."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))))


@dataclass(frozen=True)
class Turned:
    """A turn that was made: counts of the gyro (samples, 3) over so many seconds, and the verticals in body axes, of
    length 1, before and after it."""

    counts: FloatArray
    seconds: float
    before: FloatArray
    after: FloatArray

    @property
    def angle_deg(self) -> float:
        return angle_deg(self.before, self.after)

    def angles_rad(self, zeros: FloatArray, unit_dps: float) -> FloatArray:
        """Angles of each sample about the sensor's axes, (samples, 3)."""
        return np.asarray(np.radians((self.counts - zeros) * unit_dps) * (self.seconds / len(self.counts)))

    def carried(self, angles_rad: FloatArray) -> FloatArray:
        """Where turns about the body's axes, (samples, 3), one after the other carry the vertical."""
        return np.asarray(_product(_rotations(-angles_rad)) @ self.before)


def _rotations(vectors: FloatArray) -> FloatArray:
    """Rotation matrices of rotation vectors, (..., 3) to (..., 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    nothing = np.zeros_like(x)
    cross = np.stack([nothing, -z, y, z, nothing, -x, -y, x, nothing], axis=-1).reshape(*x.shape, 3, 3)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * (cross @ cross))


def _product(rotations: FloatArray) -> FloatArray:
    """All of them, the first one applied first."""
    while len(rotations) > 1:
        if len(rotations) % 2:
            rotations = np.concatenate([rotations, np.eye(3)[None]])
        rotations = rotations[1::2] @ rotations[0::2]
    return np.asarray(rotations[0])


def turn_refusal(turn: Turned, zeros: FloatArray, channel: Channel, least_deg: float) -> str | None:
    """Why a turn cannot be used, in a sentence that says what to do; None where it can."""
    if turn.angle_deg < least_deg:
        return f"it turned by {turn.angle_deg:.0f} degrees: turn it by 90"
    if np.any(turn.counts <= channel.min_counts) or np.any(turn.counts >= channel.max_counts):
        return "the gyro was at its limit: turn it more slowly"
    felt = np.degrees(turn.angles_rad(zeros, channel.unit_per_count).sum(axis=0))
    whole = float(np.linalg.norm(felt))
    if whole < 0.3 * turn.angle_deg:
        return f"the gyro hardly felt a turn of {turn.angle_deg:.0f} degrees: check its wire and its supply"
    if np.max(np.abs(felt)) < 0.9 * whole:
        return f"it turned by {_degrees(felt)} about the gyro's axes: turn it about one axis only"
    if whole > 2.0 * turn.angle_deg:
        return f"the gyro felt {whole:.0f} degrees, for {turn.angle_deg:.0f}: turn it once, the short way"
    try:
        _require_scale("gyro", turn.angle_deg / whole)
    except UsageError as error:
        return str(error)
    return None


def _degrees(felt: FloatArray) -> str:
    return ", ".join(f"{name} {value:+z.0f} deg" for name, value in zip("xyz", felt, strict=True))


def gyroscope(turns: Sequence[Turned], zeros: FloatArray, channel: Channel, accel: Fit) -> Fit:
    """The gyro from its counts at rest and one turn about each axis of the body. accel: the calibrated accelerometer.

    Raises UsageError for turns of which no axis map comes."""
    felt = np.stack([turn.angles_rad(zeros, channel.unit_per_count).sum(axis=0) for turn in turns], axis=1)
    wanted = np.stack([_axis(turn) * np.linalg.norm(felt[:, i]) for i, turn in enumerate(turns)], axis=1)
    axis_map = nearest_map(wanted @ np.linalg.pinv(felt))
    if axis_map is None or np.linalg.det(axis_map) < 0.0:
        raise UsageError("the turns were not about three axes of the gyro: turn it about one axis only, the short way")
    start = _lean(accel.matrix) @ axis_map
    spread = np.where(np.eye(3, dtype=bool), GYRO_SCALE, GYRO_RAD).ravel()
    angles = [turn.angles_rad(zeros, channel.unit_per_count) for turn in turns]

    def missed(bend: FloatArray) -> FloatArray:
        """Distances from the verticals and from the start, in standard deviations."""
        matrix = start @ (np.eye(3) + bend.reshape(3, 3))
        ends = [turn.carried(one @ matrix.T) - turn.after for turn, one in zip(turns, angles, strict=True)]
        return np.concatenate([np.concatenate(ends) / VERTICAL_RAD, bend / spread])

    bend = np.zeros(9)
    for _ in range(ITERATIONS):
        now, step = missed(bend), 1e-5
        slope = np.stack([(missed(bend + step * one) - now) / step for one in np.eye(9)], axis=1)
        bend = bend - np.linalg.lstsq(slope, now, rcond=None)[0]
    matrix = start @ (np.eye(3) + bend.reshape(3, 3))
    return Fit(zeros, np.full(3, channel.unit_per_count), matrix)


def _axis(turn: Turned) -> FloatArray:
    """The axis of the shortest turn between two verticals: a body that turns about it takes one to the other."""
    axis = np.cross(turn.after, turn.before)
    return np.asarray(axis / np.linalg.norm(axis))


def _lean(matrix: FloatArray) -> FloatArray:
    """The small rotation by which a mounting differs from an axis map: both sensors lean alike on one board."""
    rotation = nearest_rotation(matrix)
    axis_map = nearest_map(rotation)
    assert axis_map is not None  # the readings were taken side by side
    return np.asarray(rotation @ axis_map.T)

"""Calibrate a gyro and the accelerometer axes of a system from poses at rest and one turn.

An accelerometer axis that points up reads +1 g, and one that points down -1 g: these two readings give its gain, with
the sign that it is mounted with, and its zero. Both errors grow with the square of a pose's error. The other poses
then show how exact each pose was. The gyro's zero is its mean at rest; its gain, with its sign, is the angle of one
turn, which the calibrated accelerometer measures before and after, over the counts added up meanwhile.

Gains and zeros are the fields of `plumb.spec.tuning.Channel`; `words` turns them into parameters, with their limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from plumb.errors import UsageError
from plumb.spec.tuning import Channel
from plumb.tuning.groups import channel_words

MOVED_G, MOVED_DPS = 0.05, 5.0
"""Standard deviation of a reading beyond which the sensor was not at rest."""
DRIFTED_G = 0.02
"""Difference of the means of both halves of a reading beyond which it was not at rest."""
COARSE_G = 0.45
"""Largest error of a reading against its pose before the calibration: zero error of the sensor and 15 degrees."""
FINE_DEG = 6.0
"""Largest error of a pose; its cosine costs 0.5 % of gain."""
SCALE = (0.7, 1.4)
"""Gain in proportion to that of the data sheet: another part or range is outside."""
TURN_LEAST_DEG = 45.0
LARGEST_NORM_ERROR_G = 0.03
"""Deviation from 1 g, rms over the poses, beyond which the poses contradict each other."""
WORDS_PER_UNIT = {"turn/s": Fraction(1 << 28, 360), "g": Fraction(1 << 26)}
"""Unit of a calibration group -> its integers (Q28, Q26) in one deg/s or g."""


@dataclass(frozen=True)
class Pose:
    """An orientation at rest. text: how to hold it. up_g: specific force of each accelerometer group, in g."""

    name: str
    text: str
    up_g: Mapping[str, float]

    @property
    def axis(self) -> str:
        """The group that points up or down."""
        return max(self.up_g, key=lambda group: abs(self.up_g[group]))


@dataclass(frozen=True)
class BodyTurn:
    """A turn by 90 degrees about an axis of the body, from one pose to another."""

    text: str
    begin: str
    end: str


@dataclass(frozen=True)
class Turn(BodyTurn):
    """The turn that shows the gyro's sign and gain: from one pose to another, in which the tilt grows.

    horizontal, upright: the groups whose arctangent is the tilt.
    """

    gyro: str
    horizontal: str
    upright: str


@dataclass(frozen=True)
class Reading:
    """Raw counts of one pose, or of the turn. mean, deviation: by group; drift: difference of the means of both
    halves. samples: received, expected: sent by the board; seconds: time of the expected ones."""

    mean: Mapping[str, float]
    deviation: Mapping[str, float]
    drift: Mapping[str, float]
    samples: int
    expected: int
    seconds: float

    @property
    def complete(self) -> bool:
        return self.samples >= 0.98 * self.expected and self.samples > 1


Channels = Mapping[str, Channel]
"""Calibration by group."""


def value(channel: Channel, counts: float) -> float:
    return (counts - channel.zero_counts) * channel.unit_per_count


def refusal(
    pose: Pose, reading: Reading, channels: Channels, gyro: str, earlier: Mapping[str, tuple[Pose, Reading]]
) -> str | None:
    """Why the reading cannot be of this pose, in a sentence that says what to do; None where it may be."""
    if not reading.complete:
        return f"only {reading.samples} of {reading.expected} samples came: check the link"
    for group, counts in reading.mean.items():
        channel = channels[group]
        if not channel.min_counts <= counts <= channel.max_counts:
            limits = f"{channel.min_counts} to {channel.max_counts}"
            return f"{group} reads {counts:.0f} counts, outside {limits}: check its wire and its supply"
    if reading.deviation[gyro] * abs(channels[gyro].unit_per_count) > MOVED_DPS:
        return "the gyro felt a motion: put it down, let go, and wait"
    for group in pose.up_g:
        scale = abs(channels[group].unit_per_count)
        if reading.deviation[group] * scale > MOVED_G or abs(reading.drift[group]) * scale > DRIFTED_G:
            return f"{group} felt a motion: put it down, let go, and wait"
    return _not_the_pose(pose, reading, channels) or _seen_before(pose, reading, channels, earlier)


def _not_the_pose(pose: Pose, reading: Reading, channels: Channels) -> str | None:
    """That another axis points up than that of the pose. Signs do not count: they are not known yet."""
    felt = {group: value(channels[group], reading.mean[group]) for group in pose.up_g}
    wrong = [group for group in felt if abs(abs(felt[group]) - abs(pose.up_g[group])) > COARSE_G]
    if not wrong:
        return None
    reads = ", ".join(f"{group} {felt[group]:+z.2f} g" for group in felt)
    wanted = ", ".join(f"{group} {abs(pose.up_g[group]):.0f} g" for group in felt)
    swapped = "; or the wires of both axes are swapped" if len(wrong) > 1 else ""
    return f"this is another pose: it reads {reads}, and up or down should be {wanted}{swapped}"


def _seen_before(
    pose: Pose, reading: Reading, channels: Channels, earlier: Mapping[str, tuple[Pose, Reading]]
) -> str | None:
    """That this pose is the same as an earlier one of its axis, not its opposite."""
    axis = pose.axis
    for other, before in earlier.values():
        if other.name != pose.name and other.axis == axis:
            apart_g = abs(reading.mean[axis] - before.mean[axis]) * abs(channels[axis].unit_per_count)
            if apart_g < 1.0:
                return f"it reads the same as in the pose '{other.name}': turn it to the opposite side"
    return None


def accelerometer(poses: Sequence[Pose], readings: Mapping[str, Reading], channels: Channels) -> dict[str, Channel]:
    """The calibrated accelerometer groups. Raises UsageError for a gain that no such sensor has."""
    found = {}
    for group in dict.fromkeys(pose.axis for pose in poses):
        high, low = (
            next(pose for pose in poses if pose.axis == group and pose.up_g[group] * sign > 0.0) for sign in (1, -1)
        )
        up, down = readings[high.name].mean[group], readings[low.name].mean[group]
        gain = (high.up_g[group] - low.up_g[group]) / (up - down)
        zero = up - high.up_g[group] / gain
        _require_scale(group, gain, channels[group].unit_per_count)
        found[group] = Channel(zero, gain, channels[group].min_counts, channels[group].max_counts)
    return found


def _require_scale(group: str, gain: float, nominal: float) -> None:
    ratio = abs(gain / nominal)
    if not SCALE[0] <= ratio <= SCALE[1]:
        raise UsageError(
            f"{group}: a count is {ratio:.2f} times what the parameters say, and a part of this kind is within "
            f"{SCALE[0]:g} to {SCALE[1]:g}: choose the tuning for this sensor, or check its range, then begin again"
        )


def pose_error_deg(pose: Pose, reading: Reading, channels: Channels) -> float:
    """Angle between the pose and what the calibrated accelerometer reads."""
    felt = {group: value(channels[group], reading.mean[group]) for group in pose.up_g}
    norm = math.sqrt(sum(one * one for one in felt.values()))
    along = sum(felt[group] * pose.up_g[group] for group in felt) / norm if norm else 0.0
    return math.degrees(math.acos(min(max(along, -1.0), 1.0)))


def worst_pose(poses: Sequence[Pose], readings: Mapping[str, Reading], channels: Channels) -> tuple[Pose, float] | None:
    """The pose that was held worst, and by how many degrees; None where all are good enough."""
    errors = [(pose_error_deg(pose, readings[pose.name], channels), pose) for pose in poses]
    worst_deg, pose = max(errors, key=lambda entry: entry[0])
    return (pose, worst_deg) if worst_deg > FINE_DEG else None


def turned_deg(turn: Turn, before: Reading, after: Reading, channels: Channels) -> float:
    """Angle of the turn by the accelerometer, before against after, -180 to 180."""
    tilts = [
        math.atan2(
            value(channels[turn.horizontal], reading.mean[turn.horizontal]),
            value(channels[turn.upright], reading.mean[turn.upright]),
        )
        for reading in (before, after)
    ]
    return math.degrees(math.remainder(tilts[1] - tilts[0], 2.0 * math.pi))


def gyroscope(turn: Turn, zero: float, moving: Reading, angle_deg: float, nominal: Channel) -> Channel:
    """The calibrated gyro. moving: the reading over the whole turn. Raises UsageError for a turn that was too small, or
    a gain that no such sensor has."""
    if abs(angle_deg) < TURN_LEAST_DEG:
        raise UsageError(f"it turned by {angle_deg:.0f} degrees: turn it by 90, {turn.text}")
    counts_s = (moving.mean[turn.gyro] - zero) * moving.seconds
    if abs(counts_s * nominal.unit_per_count) < 0.3 * abs(angle_deg):
        raise UsageError(
            f"the gyro hardly felt a turn of {angle_deg:.0f} degrees: check its wire, its supply and its axis"
        )
    gain = angle_deg / counts_s
    _require_scale(turn.gyro, gain, nominal.unit_per_count)
    return Channel(zero, gain, nominal.min_counts, nominal.max_counts)


@dataclass(frozen=True)
class Residual:
    """What is wrong with a calibration, on readings at rest and over a turn. norm_g: deviation from 1 g, rms.
    pose_deg: angle to the pose, rms. bias_dps: rate at rest. turn_deg: gyro against accelerometer over the turn."""

    norm_g: float
    pose_deg: float
    bias_dps: float
    turn_deg: float


def residual(
    poses: Sequence[Pose],
    readings: Mapping[str, Reading],
    channels: Channels,
    turn: Turn,
    moving: Reading,
    angle_deg: float,
) -> Residual:
    """The residual of these channels. angle_deg: what the turn was."""
    norms, angles, rates = [], [], []
    for pose in poses:
        reading = readings[pose.name]
        squares = sum(value(channels[group], reading.mean[group]) ** 2 for group in pose.up_g)
        norms.append(math.sqrt(squares) - 1.0)
        angles.append(pose_error_deg(pose, reading, channels))
        rates.append(value(channels[turn.gyro], reading.mean[turn.gyro]))
    bias_dps = sum(rates) / len(rates)
    felt_deg = (value(channels[turn.gyro], moving.mean[turn.gyro]) - bias_dps) * moving.seconds
    return Residual(_rms(norms), _rms(angles), bias_dps, felt_deg - angle_deg)


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))


def words(channels: Channels, units: Mapping[str, str]) -> dict[str, int]:
    """Parameters of these groups. units: of their offset, by group. Raises UsageError for what their integers cannot
    hold."""
    found: dict[str, int] = {}
    for group, channel in channels.items():
        found.update(channel_words(group, channel, WORDS_PER_UNIT[units[group]]))
    return found


def channels_of(values: Mapping[str, int], units: Mapping[str, str]) -> dict[str, Channel]:
    """The calibration that a table of parameters holds, by group."""
    found = {}
    for group, unit in units.items():
        gain = values[f"{group}.gain"]
        if not gain:
            raise UsageError(f"{group}.gain is 0: load a tuning first, plumb params tuning SYSTEM")
        zero = -values[f"{group}.offset"] / gain
        per_count = float(gain / WORDS_PER_UNIT[unit])
        found[group] = Channel(zero, per_count, values[f"{group}.raw_min"], values[f"{group}.raw_max"])
    return found

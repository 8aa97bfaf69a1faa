"""Calibrate three-axis sensors of a board on its own readings: six poses, three turns, and the parameters that follow.

The board stays disarmed. Nothing is written to it. The turns back, and the rests at their ends, are not used for the
result: on them it shows what is wrong before and after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plumb import systems
from plumb.calibration.axis_calibration import (
    MOST_TURN_ERROR,
    REST_S,
    SETTLE_S,
    TURN_S,
    Calibrated,
    Calibration,
    Operator,
    ReadingRefusedError,
    marker,
    require_sensors,
)
from plumb.errors import UsageError, VerdictError
from plumb.link import parameter_table, raw_capture
from plumb.link.session import Session
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.parameter_file import by_name
from plumb.systems.contracts import POSES, VectorPoses
from plumb.tuning import sides, vector_calibration
from plumb.tuning.pose_calibration import FINE_DEG, LARGEST_NORM_ERROR_G, TURN_LEAST_DEG, Pose, Residual
from plumb.tuning.sides import VectorReading
from plumb.tuning.vector_calibration import Fit, Sensor, Turned

LEFT_G = 0.005
"""Rest of an axis' zero, after one zero for all axes, that is not reported: a tilt of 0.3 degrees."""


def calibration_of(session: Session) -> Calibration | VectorCalibration:
    """The calibration of the system that the board runs. Raises UsageError for a system without poses."""
    session.require_match()
    name = declarations.name_of(by_name(parameter_table.read_table(session))["system"])
    poses = systems.load(name, POSES)
    return VectorCalibration(session, name, poses) if isinstance(poses, VectorPoses) else Calibration(session)


@dataclass(frozen=True)
class Checked:
    """Readings that the result does not use: rests by the pose that they are in, and turns."""

    rests: Sequence[tuple[Pose, VectorReading]]
    turns: Sequence[tuple[Pose, VectorReading, VectorReading, VectorReading]]
    """The pose that it leads to, the reading at rest before, in motion, and at rest after it."""


class VectorCalibration:
    """One calibration of a board with three-axis sensors over its session."""

    def __init__(self, session: Session, name: str, poses: VectorPoses) -> None:
        self.session, self.system, self.poses = session, name, poses
        self.table = by_name(parameter_table.read_table(session))
        self.gyro, self.accel = poses.sensors_of(self.table)
        """The calibration in use."""
        self._by_name = {pose.name: pose for pose in poses.POSES}
        self._channels = {one.name: number for number, one in enumerate(declarations.system(name).channels)}

    def run(self, operator: Operator) -> Calibrated:
        """Take the readings and compute the calibration. Raises VerdictError when they contradict each other, LinkError
        when a sensor is lost."""
        try:
            accel = self._posed(operator)
            while True:
                try:
                    return self._turned(accel, operator)
                except ReadingRefusedError as error:
                    operator.refused(str(error))
        finally:
            self.session.end()

    def _posed(self, operator: Operator) -> Fit:
        """The accelerometer from the readings of all poses."""
        poses = self.poses.POSES
        readings: dict[str, VectorReading] = {}
        for pose in poses:
            readings[pose.name] = self._at_rest(pose, readings, operator)
        while True:
            means = {name: reading.accel.mean(axis=0) for name, reading in readings.items()}
            fit = vector_calibration.accelerometer(poses, means, self.accel.channel)
            errors = {
                pose.name: vector_calibration.angle_deg(fit.value(means[pose.name]), vector_calibration.up(pose))
                for pose in poses
            }
            worst = max(errors, key=lambda name: errors[name])
            if errors[worst] <= FINE_DEG:
                return fit
            operator.refused(f"the pose '{worst}' was {errors[worst]:.0f} degrees off: hold it more exactly")
            readings[worst] = self._at_rest(self._by_name[worst], readings, operator)

    def _at_rest(self, pose: Pose, earlier: dict[str, VectorReading], operator: Operator) -> VectorReading:
        """The reading of a pose, asked for until it can be one."""
        seen = {
            name: (self._by_name[name], sides.felt_g(reading, self.accel.channel)) for name, reading in earlier.items()
        }
        while True:
            operator.place(pose)
            raw_capture.begin(self.session, self._channels)
            self._listen(SETTLE_S)
            reading = self._listen(REST_S)
            require_sensors(self.session)
            reason = sides.refusal(pose, reading, self.gyro.channel, self.accel.channel, seen)
            if reason is None:
                return reading
            operator.refused(f"{pose.name}: {reason}")

    def _turned(self, accel: Fit, operator: Operator) -> Calibrated:
        """The gyro from the turns there; the turns back then check the whole calibration.

        Raises ReadingRefusedError for a turn that cannot be used."""
        path = [turn.end for turn in self.poses.TURNS]
        begin = self._by_name[self.poses.TURNS[0].begin]
        last = begin, self._at_rest(begin, {}, operator)
        self._require_pose(accel, *last)
        turns: list[Turned] = []
        zeros = [last[1].gyro.mean(axis=0)]
        for turn in self.poses.TURNS:
            there = self._turn(accel, last, turn.text, self._by_name[turn.end], operator)
            turns.append(turned_by(accel, last[1], *there))
            last = self._by_name[turn.end], there[1]
            zeros.append(there[1].gyro.mean(axis=0))
        zero = np.mean(zeros, axis=0)
        try:
            gyro = vector_calibration.gyroscope(turns, zero, self.gyro.channel, accel)
        except UsageError as error:
            raise ReadingRefusedError(str(error)) from None
        checked = Checked([], [])
        for name in [*reversed(path[:-1]), path[-1]]:
            pose, before = self._by_name[name], last[1]
            moving, rest = self._turn(accel, last, f"turn it back: {pose.text}", pose, operator)
            checked = Checked([*checked.rests, (pose, rest)], [*checked.turns, (pose, before, moving, rest)])
            last = pose, rest
        return self._result(accel, gyro, checked)

    def _turn(
        self, accel: Fit, last: tuple[Pose, VectorReading], text: str, pose: Pose, operator: Operator
    ) -> tuple[VectorReading, VectorReading]:
        """The reading over the turn to this pose, and that at rest in it."""
        operator.turn(text, pose)
        raw_capture.begin(self.session, self._channels)
        moving, rest = self._listen(TURN_S), self._listen(REST_S)
        require_sensors(self.session)
        if not moving.complete:
            raise ReadingRefusedError("the turn: samples were lost: check the link")
        self._require_pose(accel, pose, rest)
        turn = turned_by(accel, last[1], moving, rest)
        zero = (last[1].gyro.mean(axis=0) + rest.gyro.mean(axis=0)) / 2.0
        reason = vector_calibration.turn_refusal(turn, zero, self.gyro.channel, TURN_LEAST_DEG)
        if reason:
            raise ReadingRefusedError(f"the turn to '{pose.name}': {reason}; the turns begin again")
        return moving, rest

    def _require_pose(self, accel: Fit, pose: Pose, rest: VectorReading) -> None:
        """Raises ReadingRefusedError unless the body is at rest in this pose."""
        reason = sides.unusable(rest, self.gyro.channel, self.accel.channel)
        if reason is None:
            off_deg = vector_calibration.angle_deg(accel.value(rest.accel.mean(axis=0)), vector_calibration.up(pose))
            if off_deg <= TURN_LEAST_DEG / 2.0:
                return
            reason = f"it is {off_deg:.0f} degrees off"
        raise ReadingRefusedError(f"'{pose.name}' at the end of the turn: {reason}; the turns begin again")

    def _listen(self, seconds: float) -> VectorReading:
        counts = raw_capture.counts(self.session, self._channels, seconds)
        gyro, accel = (
            raw_capture.vectors([counts[name] for name in names]) for names in (self.poses.GYRO, self.poses.ACCEL)
        )
        return VectorReading(gyro, accel, round(seconds * 1e6 / self.table["period_us"]), seconds)

    def _result(self, accel: Fit, gyro: Fit, checked: Checked) -> Calibrated:
        exact = residual(checked, gyro, accel)
        turned_deg = np.mean([turned_by(accel, *turn[1:]).angle_deg for turn in checked.turns])
        if exact.norm_g > LARGEST_NORM_ERROR_G:
            raise VerdictError(
                f"the readings contradict each other: gravity is {1e3 * exact.norm_g:.0f} mg off after the "
                "calibration; nothing was written; begin again, on a firm surface"
            )
        if exact.turn_deg > MOST_TURN_ERROR * turned_deg:
            raise ReadingRefusedError(
                f"the gyro was {exact.turn_deg:.0f} degrees off the accelerometer on the way back: turn it about one "
                "axis only, within the time; the turns begin again"
            )
        found = gyro.sensor(self.gyro.channel), accel.sensor(self.accel.channel)
        words = self.poses.words_of(*found) | marker(self.system, self.table)
        changed = {name: word for name, word in words.items() if word != self.table[name]}
        before, after = residual(checked, self.gyro, self.accel), residual(checked, *found)
        return Calibrated(self.system, self.table, changed, before, after, tuple(remarks(accel, found[1])))


def turned_by(accel: Fit | Sensor, before: VectorReading, moving: VectorReading, after: VectorReading) -> Turned:
    """A turn with the verticals at its ends, by this accelerometer."""
    ends = [accel.value(rest.accel.mean(axis=0)) for rest in (before, after)]
    first, last = (end / np.linalg.norm(end) for end in ends)
    return Turned(moving.gyro, moving.seconds, first, last)


def residual(checked: Checked, gyro: Fit | Sensor, accel: Fit | Sensor) -> Residual:
    """Errors of these sensors on readings that the calibration did not use. rate at rest: the length of its mean;
    gyro over the turns: rms."""
    felt = [(pose, accel.value(rest.accel.mean(axis=0))) for pose, rest in checked.rests]
    norms = [float(np.linalg.norm(one)) - 1.0 for _, one in felt]
    poses = [vector_calibration.angle_deg(one, vector_calibration.up(pose)) for pose, one in felt]
    rates = [gyro.value(rest.gyro.mean(axis=0)) for _, rest in checked.rests]
    missed = []
    for _, before, moving, after in checked.turns:
        turn = turned_by(accel, before, moving, after)
        zero = (gyro.value(before.gyro.mean(axis=0)) + gyro.value(after.gyro.mean(axis=0))) / 2.0
        angles = np.radians(gyro.value(moving.gyro) - zero) * (moving.seconds / len(moving.gyro))
        missed.append(vector_calibration.angle_deg(turn.carried(angles), turn.after))
    return Residual(_rms(norms), _rms(poses), float(np.linalg.norm(np.mean(rates, axis=0))), _rms(missed))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def remarks(accel: Fit, sensor: Sensor) -> list[str]:
    """How the sensor is mounted, and what the board's parameters cannot hold."""
    said = [f"mounted {axes_text(sensor.matrix)}"]
    left = accel.left(sensor)
    if np.max(np.abs(left)) > LEFT_G:
        most_deg = np.degrees(np.linalg.norm(left))
        shown = ", ".join(f"{axis} {1e3 * one:+z.0f}" for axis, one in zip("xyz", left, strict=True))
        said.append(
            f"of the accelerometer's zeros {shown} mg stay, up to {most_deg:.1f} deg of tilt: the board has one zero "
            "for all three axes"
        )
    return said


def axes_text(matrix: FloatArray) -> str:
    """A mounting in words: which axis of the sensor points along each axis of the body."""
    axis_map = vector_calibration.nearest_map(matrix)
    if axis_map is None:
        return "aslant"
    columns = np.argmax(np.abs(axis_map), axis=1)
    names = [f"{'-+'[int(row[column] > 0)]}{'xyz'[column]}" for row, column in zip(axis_map, columns, strict=True)]
    return ", ".join(f"body {axis} = sensor {name}" for axis, name in zip("xyz", names, strict=True))

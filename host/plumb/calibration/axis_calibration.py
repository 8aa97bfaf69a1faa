"""Calibrate the sensors of a board on its own readings: poses at rest, one turn, and the parameters that follow.

The board stays disarmed. Nothing is written to it: the result are parameters that a caller commits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Protocol

from plumb import systems
from plumb.errors import LinkError, UsageError, VerdictError
from plumb.link import parameter_table, raw_capture
from plumb.link.identity import sensors_text
from plumb.link.session import Session
from plumb.spec import declarations, parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.system import RECEIVER
from plumb.spec.tuning import Channel
from plumb.systems.contracts import POSES, TiltPoses
from plumb.tuning import pose_calibration
from plumb.tuning.pose_calibration import Pose, Reading, Residual

SETTLE_S = 1.2
"""Time from the moment that a body is said to be in its pose until the reading begins."""
REST_S = 2.0
TURN_S = 5.0
"""Length of the reading in which the turn has to happen."""
MOST_TURN_ERROR = 0.05
"""Largest difference between gyro and accelerometer on the way back, in proportion to the turn."""


class Operator(Protocol):
    """The holder of the body. Every method may raise to give up."""

    def place(self, pose: Pose) -> None:
        """Return when the body is in this pose, and at rest."""

    def turn(self, text: str, end: Pose) -> None:
        """Return when the reading may begin during which the body is turned to the pose `end`. text: how."""

    def refused(self, reason: str) -> None:
        """Called with the reason when a reading was not taken; it is asked for again."""


class ReadingRefusedError(Exception):
    """A reading cannot be used; the text says why, and what to do."""


@dataclass(frozen=True)
class Calibrated:
    """The result. words: the parameters that change, by name; table: all that are in use now. before, after: on
    readings that the calibration did not use."""

    system: str
    table: dict[str, int]
    words: dict[str, int]
    before: Residual
    after: Residual
    remarks: tuple[str, ...]
    """Further remarks, in sentences: how a sensor is mounted."""


MARKER = "calibrated"


def marker(system: str, table: Mapping[str, int]) -> dict[str, int]:
    """The parameter that says so, of a system that a pilot arms only when it is calibrated."""
    return {MARKER: 1} if MARKER in table and RECEIVER in declarations.system(system).parts else {}


def sensors_missing(session: Session) -> list[str]:
    """Sentences about the sensors that do not work, from the latest telemetry. An input that does not change may be at
    rest: the readings show that."""
    return [text for text in sensors_text(session.telemetry.get("SENSORS", {})) if "does not change" not in text]


def require_sensors(session: Session) -> None:
    """Raises LinkError when a sensor of the board does not work."""
    lost = sensors_missing(session)
    if lost:
        raise LinkError(f"{'; '.join(lost)}: check its wires and its supply, then begin again")


class Calibration:
    """One calibration of a board that tilts about one axis, over its session. Raises UsageError for a system without
    poses, or with poses of three axes."""

    def __init__(self, session: Session) -> None:
        session.require_match()
        self.session = session
        self.table = by_name(parameter_table.read_table(session))
        self.system = declarations.name_of(self.table["system"])
        poses = systems.load(self.system, POSES)
        if not isinstance(poses, TiltPoses):
            raise UsageError(f"{self.system} is calibrated about three axes")
        self.poses = poses
        declared = declarations.system(self.system).channels
        of_group = [(one.calibration, number) for number, one in enumerate(declared) if one.calibration]
        self._numbers = dict(reversed(of_group))  # of a group with several channels the first is read
        units = {row.name: row.unit for row in parameters.table()}
        self._units = {group: units[f"{group}.offset"] for group in self._numbers}
        self.channels = pose_calibration.channels_of(self.table, self._units)
        """The calibration in use."""

    def run(self, operator: Operator) -> Calibrated:
        """Take the readings and compute the calibration. Raises VerdictError when they contradict each other, LinkError
        when a sensor is lost."""
        try:
            readings, channels = self._posed(operator)
            while True:
                try:
                    return self._turned(readings, channels, operator)
                except ReadingRefusedError as error:
                    operator.refused(str(error))
        finally:
            self.session.end()

    def _posed(self, operator: Operator) -> tuple[dict[str, Reading], dict[str, Channel]]:
        """The readings of all poses, and the channels with the accelerometer that follows from them."""
        poses = self.poses.POSES
        readings: dict[str, Reading] = {}
        for pose in poses:
            readings[pose.name] = self._at_rest(pose, readings, operator)
        while True:
            channels = {**self.channels, **pose_calibration.accelerometer(poses, readings, self.channels)}
            worst = pose_calibration.worst_pose(poses, readings, channels)
            if worst is None:
                return readings, channels
            pose, error_deg = worst
            operator.refused(f"the pose '{pose.name}' was {error_deg:.0f} degrees off: hold it more exactly")
            readings[pose.name] = self._at_rest(pose, readings, operator)

    def _at_rest(self, pose: Pose, earlier: Mapping[str, Reading], operator: Operator) -> Reading:
        """The reading of a pose, asked for until it can be one."""
        seen = {one.name: (one, earlier[one.name]) for one in self.poses.POSES if one.name in earlier}
        while True:
            operator.place(pose)
            raw_capture.begin(self.session, self._numbers)
            self._listen(SETTLE_S)
            reading = self._listen(REST_S)
            require_sensors(self.session)
            reason = pose_calibration.refusal(pose, reading, self.channels, self.poses.TURN.gyro, seen)
            if reason is None:
                return reading
            operator.refused(f"{pose.name}: {reason}")

    def _turned(
        self, readings: Mapping[str, Reading], channels: Mapping[str, Channel], operator: Operator
    ) -> Calibrated:
        """The gyro from the turn there; the turn back and the rests at both ends then check the whole calibration.

        Raises ReadingRefusedError for a turn that cannot be used."""
        turn = self.poses.TURN
        ends = {name: next(pose for pose in self.poses.POSES if pose.name == name) for name in (turn.begin, turn.end)}
        others = {name: reading for name, reading in readings.items() if name not in ends}
        begin = self._at_rest(ends[turn.begin], others, operator)
        there, end = self._turn_to(ends[turn.end], turn.text, operator)
        try:
            angle_deg = pose_calibration.turned_deg(turn, begin, end, channels)
            zero = fmean(rest.mean[turn.gyro] for rest in (begin, end))  # it wanders: that of these minutes counts
            gyro = pose_calibration.gyroscope(turn, zero, there, angle_deg, self.channels[turn.gyro])
        except UsageError as error:
            raise ReadingRefusedError(str(error)) from None
        back, again = self._turn_to(ends[turn.begin], f"tilt it back, {turn.begin}", operator)
        back_deg = pose_calibration.turned_deg(turn, end, again, channels)
        rests = {turn.begin: again, turn.end: end}
        after = {**channels, turn.gyro: gyro}
        residuals = [
            pose_calibration.residual(tuple(ends.values()), rests, one, turn, back, back_deg)
            for one in (self.channels, after)
        ]
        if abs(residuals[1].turn_deg) > MOST_TURN_ERROR * abs(back_deg):
            raise ReadingRefusedError(
                f"the gyro felt {residuals[1].turn_deg:+z.0f} degrees more on the way back than the accelerometer: "
                "turn it about one axis only, within the time"
            )
        return self._result(after, residuals[0], residuals[1])

    def _turn_to(self, pose: Pose, text: str, operator: Operator) -> tuple[Reading, Reading]:
        """The reading over the turn to this pose, and that at rest in it."""
        operator.turn(text, pose)
        raw_capture.begin(self.session, self._numbers)
        moving, rest = self._listen(TURN_S), self._listen(REST_S)
        reason = pose_calibration.refusal(pose, rest, self.channels, self.poses.TURN.gyro, {})
        if reason or not moving.complete:
            raise ReadingRefusedError(f"the turn: {reason or 'samples were lost: check the link'}")
        return moving, rest

    def _listen(self, seconds: float) -> Reading:
        return raw_capture.capture(self.session, self._numbers, seconds, self.table["period_us"])

    def _result(self, channels: dict[str, Channel], before: Residual, after: Residual) -> Calibrated:
        if after.norm_g > pose_calibration.LARGEST_NORM_ERROR_G:
            raise VerdictError(
                f"the readings contradict each other: gravity is {1e3 * after.norm_g:.0f} mg off after the "
                "calibration; nothing was written; begin again, on a firm surface"
            )
        words = pose_calibration.words(channels, self._units) | marker(self.system, self.table)
        changed = {name: word for name, word in words.items() if word != self.table[name]}
        remarks = tuple(
            f"{group} is mounted the other way round: its sign is turned"
            for group, channel in channels.items()
            if channel.unit_per_count * self.channels[group].unit_per_count < 0.0
        )
        return Calibrated(self.system, self.table, changed, before, after, remarks)

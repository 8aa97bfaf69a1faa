"""Reports of a board: its identity, and in a run the results of every step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from plumb.api.signals import ReceivedStep
from plumb.link.monitor import Monitor, require_frames
from plumb.link.realtime import unwrap
from plumb.link.retries import REPLY_TIMEOUT_S
from plumb.link.session import Session
from plumb.spec import dbc
from plumb.spec.protocol import Frame
from plumb.spec.signals import signals
from plumb.tuning.quantities import Value

HEALTH_EVERY_S = 0.1


@dataclass(frozen=True)
class BoardIdentity:
    """Identity of a board.

    Attributes:
        version: Version of this plumb.
        git_hash: First 16 digits of the commit that the image was built from, with `+` when the tree differed; empty
            where it is not known.
        systems: Names of the systems that the image has.
        unique_id: Number of the chip, 24 hexadecimal digits; empty for a board without a link.
        parameter_source: Where the parameters in use come from, in words.
        mismatch: Why the board takes no commands of this version, as a sentence; None where it does.
    """

    version: str
    git_hash: str
    systems: tuple[str, ...]
    unique_id: str = ""
    parameter_source: str = ""
    mismatch: str | None = None


@dataclass(frozen=True)
class Health:
    """The state of a board, as it was said at most 0.1 s before the sample.

    Attributes:
        mode: `IDLE`, `LOCKSTEP` or `REALTIME`; None where it is not known.
        blocked: A sentence for everything that is in the way of arming.
        faults: A sentence for every fault.
        disarm_cause: What disarmed the board last.
        lost_steps: Steps that were lost on the link since the stream began.
    """

    mode: str | None = None
    blocked: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    disarm_cause: tuple[str, ...] = ()
    lost_steps: int = 0


@dataclass(frozen=True)
class Gap:
    """Gap between two samples of a stream whose link was lost and came back.

    Attributes:
        reason: Why the link was lost, as a sentence.
        seconds: Time between the two samples, by the clock of this computer.
        steps: Steps of the run that did not arrive; None where a new run has begun, whose steps count from 0.
        was_armed: Whether the sample before was of an armed board. The board is not armed any more.
        changed: Parameters that are not as before: whole name -> (value before, value now), in units.
        image_changed: Whether the board runs another image than before.
    """

    reason: str
    seconds: float
    steps: int | None
    was_armed: bool
    changed: Mapping[str, tuple[Value | None, Value | None]] = field(default_factory=dict)
    image_changed: bool = False


@dataclass(frozen=True)
class Sample:
    """One step of a live board.

    Attributes:
        time_s: Time of the step, s, counted in periods from the first step of the run.
        step: Number of the step in the run, from 0.
        signals: Signals of the step by name with unit (`tilt_deg`, `bias_dps`, `pulse_0_us`), as far as the link
            carries them with the steps; a signal that was lost is missing. A mapping; the names in SI work, too,
            every name is an attribute as well, and an attitude has roll, pitch and yaw (plumb.api.signals). While the
            board is not armed its pins are neutral, whatever pulses a step comes to.
        armed: Whether the actuators may be driven.
        digest: CRC-32 of the step's words.
        health: The state of the board.
        gap: What is missing directly before this sample, of a board that was lost and came back; else None.
    """

    time_s: float
    step: int
    signals: ReceivedStep
    armed: bool
    digest: int
    health: Health
    gap: Gap | None = None


@dataclass
class _Step:
    step: int
    armed: bool
    digest: int
    signals: dict[str, float] = field(default_factory=dict)


class SampleStream:
    """Puts the frames of a run in real time together by step. Feed it with the frames as they come.

    near: about the number of the first step that will come: a frame has the low 16 bits of it."""

    def __init__(self, session: Session, system: str, period_s: float, near: int = 0) -> None:
        self._session, self._system, self._period_s = session, system, period_s
        self._monitor = Monitor(session)
        self._message = session.protocol["STEP"]
        self._named = {i: message for i, message in session.protocol.by_identifier.items() if dbc.of_system(i)}
        self._columns = {signal: (column, scale) for signal, column, scale in signals(system)}
        self._current: _Step | None = None
        self._last = near
        self._done: list[_Step] = []
        self._health, self._health_s, self._health_of_s = Health(), -HEALTH_EVERY_S, 0.0

    def feed(self, frames: list[Frame]) -> None:
        self._monitor.feed(frames)
        for identifier, data in frames:
            if identifier == self._message.identifier:
                _, second, low, digest = self._message.unpack(data)
                self._last = unwrap(self._last, low, 16)
                if self._current is not None:
                    self._done.append(self._current)
                self._current = _Step(self._last, bool(second >> 4 & 1), digest)
            elif identifier in self._named and self._current is not None:
                message = self._named[identifier]
                if unwrap(self._last, data[1] >> 4, 4) != self._current.step:
                    continue
                for name, value in zip(message.words, message.unpack(data)[2:], strict=True):
                    column, scale = self._columns.get((message.name, name), ("", 0.0))
                    if column:
                        self._current.signals[column] = value * scale

    def samples(self) -> Iterator[Sample]:
        """Receive, and give every step when the next one has begun. Raises LinkError when the board falls silent."""
        session = self._session
        while True:
            session.receive(REPLY_TIMEOUT_S)
            require_frames(session)
            done, self._done = self._done, []
            for one in done:
                time_s = one.step * self._period_s
                yield Sample(
                    time_s,
                    one.step,
                    ReceivedStep(self._system, one.signals),
                    one.armed,
                    one.digest,
                    self._state(time_s),
                )

    def _state(self, time_s: float) -> Health:
        """time_s: of the sample. A host that was busy reads many samples at once: their own time counts, too."""
        now_s = self._session.clock()
        passed_s = max(now_s - self._health_s, abs(time_s - self._health_of_s))
        if passed_s >= HEALTH_EVERY_S or self._health.mode is None:
            said = self._monitor.snapshot()
            self._health_s, self._health_of_s = now_s, time_s
            self._health = Health(
                said["mode"],
                tuple(said["blocked"]),
                tuple(said["faults"]),
                tuple(said["disarm_cause"]),
                self._monitor.lost_steps,
            )
        return self._health

"""Capture a run in real time: raw counts and digest of every step, and the first step with a lost frame.

The steps of a live run are verified by running the same raw counts through the model. From a lost count on, all steps
are unverified: neither pass nor fail.
"""

from __future__ import annotations

import bisect
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from plumb.errors import LinkError
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.link.used_tables import ALL_PARAMETERS, UsedTables
from plumb.spec import dbc
from plumb.spec.protocol import Frame


def unwrap(last: int, low: int, bits: int) -> int:
    """The number nearest to `last` whose low bits are `low`."""
    size = 1 << bits
    ahead = (low - last) % size
    return last + (ahead if ahead < size // 2 else ahead - size)


@dataclass
class SetpointReports:
    """The setpoints of a run from its SETPOINT_USED frames.

    changes: (step, value) pairs, with the first step that used the value. doubt: the first step whose setpoint is not
    known, because a report was lost. count: reports received. from_begin: this host received the run from its begin,
    which has the setpoint 0; otherwise its setpoint is unknown until the first report.
    """

    changes: list[tuple[int, int]] = field(default_factory=lambda: [(0, 0)])
    doubt: int | None = None
    count: int = 0
    from_begin: bool = True

    @property
    def newest(self) -> int | None:
        """The setpoint that the newest report names; None while it is not known."""
        return self.changes[-1][1] if self.from_begin or self.count else None

    def note(self, said: dict[str, int], last: int) -> None:
        """Record a report; one that does not follow from the one before shows that a report was lost. last: step that
        was received last."""
        (since, value), self.count = self.changes[-1], self.count + 1
        same = said["setpoint"] == value
        if same != bool(said["repeated"]) and self.doubt is None:
            self.doubt = max(since, 0)
        if not same:
            self.changes.append((unwrap(last, said["step"], 16), said["setpoint"]))

    def of_steps(self, end: int, first: int = 0) -> npt.NDArray[np.int32]:
        """The setpoint that each of the steps from `first` to before `end` used, turn_q32."""
        result = np.zeros(end - first, np.int32)
        begin = max(bisect.bisect_right(self.changes, first, key=lambda change: change[0]) - 1, 0)
        for step, value in self.changes[begin:]:
            if step >= end:
                break
            result[max(step - first, 0) :] = value
        return result


@dataclass
class Capture:
    """Frames of one real-time run, collected by step.

    raw_frames: the frames that carry the counts of a step; with (), any that arrive, and 0 for a missing count.
    digest, raw: by step number, unwrapped; raw holds the inputs of a step (0 where the system has none) once all its
    raw_frames have come.
    values: (frame, signal) -> step -> raw integer, of other selected frames. setpoints: the setpoints of the run.
    steps: number of steps received so far.
    disarmed_step: the last step at which the board was found to have disarmed. tables: the parameters of the run from
    the table on that the session last wrote or read.
    """

    session: Session
    raw_frames: Collection[str] = RAW_FRAMES[:2]
    digest: dict[int, int] = field(default_factory=dict)
    raw: dict[int, list[int]] = field(default_factory=dict)
    values: dict[tuple[str, str], dict[int, int]] = field(default_factory=dict)
    time_us: list[tuple[int, int]] = field(default_factory=list)
    setpoints: SetpointReports = field(default_factory=SetpointReports)
    steps: int = 0
    armed: bool = False
    disarmed_step: int | None = None

    def __post_init__(self) -> None:
        messages = self.session.protocol
        self._step, self._used = messages["STEP"], messages["SETPOINT_USED"]
        self._raw = {messages[name].identifier: 3 * place for place, name in enumerate(RAW_FRAMES)}
        self._inputs = 3 * len(RAW_FRAMES)
        self._raw_message = messages["RAW_A"]
        self._time = messages["TIME"]
        self.tables = UsedTables(messages, self.session.parameters.table)
        self._of_tables = self.tables.identifiers
        self._named = {i: message for i, message in messages.by_identifier.items() if dbc.of_system(i)}
        self._last = 0
        self._wanted = {messages[name].identifier for name in self.raw_frames}
        self._part: dict[int, tuple[set[int], list[int]]] = {}  # step -> frames that came, counts

    def feed(self, frames: list[Frame]) -> None:
        for identifier, data in frames:
            if identifier == self._step.identifier:
                _, second, low, digest = self._step.unpack(data)
                self._last = unwrap(self._last, low, 16)
                self.digest[self._last] = digest
                before, self.armed = self.armed, bool(second >> 4 & 1)
                if before and not self.armed:
                    self.disarmed_step = self._last
                self.steps = max(self.steps, self._last + 1)
            elif identifier in self._raw:
                _, second, *counts = self._raw_message.unpack(data)
                step = unwrap(self._last, second & 63, 6)
                self._note_raw(step, identifier, counts)
                self.steps = max(self.steps, step + 1)
            elif identifier in self._named:
                message = self._named[identifier]
                step = unwrap(self._last, data[1] >> 4, 4)
                for name, value in zip(message.words, message.unpack(data)[2:], strict=True):
                    if not name.startswith("reserved"):
                        self.values.setdefault((message.name, name), {})[step] = value
            elif identifier == self._used.identifier:
                self.setpoints.note(self._used.decode(data), self._last)
            elif identifier == self._time.identifier:
                _, _, low, time_us = self._time.unpack(data)
                self.time_us.append((unwrap(self._last, low, 16), time_us))
            elif identifier in self._of_tables:
                self.tables.feed(identifier, data, self._last + (self.steps > 0))

    @property
    def parameters_step(self) -> int | None:
        """The first step with parameters that were committed during the run."""
        return self.tables.changes[0].step if self.tables.changes else None

    def ask_for_table(self) -> None:
        """Ask the board for its table when that of a change was not seen; the answer comes among the other frames."""
        if self.tables.ask(self.session.clock()):
            self.session.send([self.session.frame("PARAM_GET", ALL_PARAMETERS, 0)])

    def _note_raw(self, step: int, identifier: int, counts: list[int]) -> None:
        """Record the three counts of a RAW frame."""
        came, whole = self._part.setdefault(step, (set(), [0] * self._inputs))
        came.add(identifier)
        at = self._raw[identifier]
        whole[at : at + 3] = counts
        if self._wanted <= came:
            self.raw[step] = whole
        self._part.pop(step - 32, None)  # the step number in these frames has six bits

    def set_setpoint(self, setpoint: int, commands: tuple[int, ...] | None = None) -> None:
        """Change the setpoint, with these words of commands or those said last, and wait for the board's report of the
        step that first used them."""
        reports = self.setpoints
        known = reports.count
        start = self.steps
        for _ in range(TRIES):
            self.session.set_inputs(setpoint, commands)
            report = self.session.listening.timeout(REPLY_TIMEOUT_S)
            while not report.over:
                self.session.receive(report.left_s)
                if reports.count > known and reports.changes[-1][1] == setpoint:
                    return
            reports.doubt = start if reports.doubt is None else reports.doubt
        raise LinkError("the board does not take the setpoint: check the cable")

    def collect(self, steps: int) -> None:
        """Receive until a frame of step number `steps` arrives, so that all frames of the steps before it have come.

        Raises LinkError when no step comes any more.
        """
        received, step = self.steps, self.session.listening.timeout(TRIES * REPLY_TIMEOUT_S)
        while self.steps <= steps:
            self.session.receive(REPLY_TIMEOUT_S)
            if self.steps > received:
                received = self.steps
                step.renew()
            elif step.over:
                raise LinkError(f"the board fell silent after step {self.steps}: check cable and power")

    def unverified_from(self, steps: int) -> int | None:
        """The first step below `steps` whose digest, raw counts or setpoint did not arrive, or that had other
        parameters than the first step; else None."""
        changed = self.parameters_step
        doubts = (self.first_doubt(steps), changed if changed is not None and changed < steps else None)
        return min((step for step in doubts if step is not None), default=None)

    def first_doubt(self, steps: int) -> int | None:
        """The first step below `steps` whose digest, raw counts or setpoint did not arrive; else None."""
        missing = [step for step in range(steps) if step not in self.digest or step not in self.raw]
        return min(missing[:1] + ([self.setpoints.doubt] if self.setpoints.doubt is not None else []), default=None)

    def inputs_until(self, steps: int) -> int | None:
        """The first step below `steps` whose raw counts or setpoint did not arrive: the state after it is not known."""
        lost = next((step for step in range(steps) if step not in self.raw), None)
        doubts = (lost, self.setpoints.doubt)
        return min((step for step in doubts if step is not None), default=None)

    def raw_counts(self, steps: int) -> npt.NDArray[np.int16]:
        """The inputs of the steps, with room for those of any system; zero where lost. Shape (steps, 6 or more)."""
        return np.array([self.raw.get(step, [0] * self._inputs) for step in range(steps)], np.int16).reshape(
            steps, self._inputs
        )

    def digests(self, steps: int) -> npt.NDArray[np.uint32]:
        """Shape (steps,); zero where lost."""
        return np.array([self.digest.get(step, 0) for step in range(steps)], np.uint32)

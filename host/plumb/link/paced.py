"""A run whose samples, setpoints and parameters the host sends in time with the board's steps, disarmed.

In lockstep a board takes no other parameters. Here the board's timer makes the steps (REALTIME_INJECTED), and the host
answers each of them with what the next one needs. Nothing holds the board back, so nothing is taken for granted: a step
counts only when the board's own frames say that every step up to it used the counts, the setpoint and the parameters
that were meant for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.contract.parameters import Changes, ControlParams
from plumb.errors import LinkError
from plumb.link.realtime import Capture
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES
from plumb.link.sample_codec import WholeNumbers, layout_of, sample_frames, whole_inputs
from plumb.link.selection import raw_frames_of
from plumb.link.session import Session
from plumb.spec import declarations, parameters
from plumb.spec.protocol import Frame

SAMPLES_AHEAD = 2
"""Samples that wait on the board: more of them would delay a commit that follows them on the wire."""
STAGED_PER_STEP = 2
"""Words of the next table that are sent between two steps, in addition to the samples."""


@dataclass(frozen=True)
class PacedAnswer:
    """The digests of the steps whose inputs are confirmed. why: they are not all of them; "" when they are."""

    digests: npt.NDArray[np.uint32]
    why: str = ""


@dataclass(frozen=True)
class _Table:
    """A whole table to be used from `step` on."""

    step: int
    words: tuple[int, ...]

    @property
    def crc32(self) -> int:
        return parameters.crc32(self.words)


class PacedRun:
    """One such run. The session has uploaded the parameters of its beginning."""

    def __init__(self, session: Session, system: str, changes: Changes, raw: WholeNumbers, setpoint: WholeNumbers):
        channels = len(declarations.system(system).channels)
        self._session, self._channels = session, channels
        self._layout = layout_of(system)
        self._raw, self._setpoint = whole_inputs(self._layout, raw), np.asarray(setpoint, np.int64)
        self._tables = _tables_of(session.parameters.table or (), changes)
        self._left = deque(self._tables)
        self._to_stage: deque[tuple[int, int]] = deque()
        self._words: Sequence[int] = session.parameters.table or ()
        self._sent = self._answered = 0
        self._sent_set = 0, self._layout.neutral
        self._capture = Capture(session, raw_frames_of(system))

    def run(self) -> PacedAnswer:
        """Run every step; the board is left idle. Raises LinkError if the board stops answering."""
        session, count = self._session, len(self._raw)
        listener = session.listener
        self._choose_words()
        while self._to_stage:
            index, word = self._to_stage.popleft()
            session.request("PARAM_SET", index, word, answer="PARAM_STAGED", first=index)
        try:
            session.listener = self._capture.feed
            session.begin("REALTIME_INJECTED", frames=self._capture.raw_frames)
            self._send_until(count)
            self._capture.collect(count)
        finally:
            session.listener = listener
            session.end()
            session.parameters.forget()
        until, why = self._confirmed(count)
        return PacedAnswer(self._capture.digests(until), why)

    # ---- what the next step needs ----

    def _send_until(self, count: int) -> None:
        capture = self._capture
        self._session.send(self._for_step(0))
        answer = self._session.listening.timeout(TRIES * REPLY_TIMEOUT_S)
        while capture.steps < count:
            self._session.receive(REPLY_TIMEOUT_S)
            if capture.steps > self._answered:
                self._answered = capture.steps
                answer.renew()
                if self._answered < count:
                    self._session.send(self._for_step(self._answered))
            elif answer.over:
                raise LinkError(f"the board fell silent after step {capture.steps}: check cable and power")

    def _for_step(self, step: int) -> list[Frame]:
        """The frames for the time before a step: what it must find first, and then the samples."""
        session, frames = self._session, []
        while self._left and self._left[0].step <= step:
            frames += [session.frame("PARAM_SET", *one) for one in self._to_stage]
            table = self._left.popleft()
            frames.append(session.frame("PARAM_COMMIT", len(table.words), table.crc32))
            self._words = table.words
            self._choose_words()
        wanted = int(self._setpoint[step]), tuple(self._raw[step, self._layout.counts :].tolist())
        if wanted != self._sent_set:
            frames += session.setpoint_frames(*wanted)
            self._sent_set = wanted
        end = min(step + SAMPLES_AHEAD, len(self._raw))
        for number in range(self._sent, end):
            counts = [int(one) for one in self._raw[number]]
            frames += sample_frames(session.protocol, number, counts[: self._layout.counts], layout=self._layout)
        self._sent = max(self._sent, end)
        for _ in range(min(STAGED_PER_STEP, len(self._to_stage))):
            frames.append(session.frame("PARAM_SET", *self._to_stage.popleft()))
        return frames

    def _choose_words(self) -> None:
        """The words of the next table that differ from the one before it."""
        self._to_stage.clear()
        if self._left:
            pairs = enumerate(zip(self._words, self._left[0].words, strict=True))
            self._to_stage.extend((index, new & 0xFFFFFFFF) for index, (old, new) in pairs if old != new)

    # ---- what the steps used ----

    def _confirmed(self, count: int) -> tuple[int, str]:
        """How many steps from the first on used what was meant for them, and why not all of them."""
        capture = self._capture
        used = capture.raw_counts(count)[:, : self._layout.size]
        ends = [(count, "")]
        lost = capture.first_doubt(count)
        if lost is not None:
            ends.append((lost, f"the board's frames of step {lost} did not all arrive"))
        carried = [*range(self._channels), *range(self._layout.counts, self._layout.size)]
        other = np.flatnonzero((used != self._raw)[:, carried].any(axis=1))
        if len(other):
            ends.append((int(other[0]), f"the sample of step {other[0]} did not reach the board in time"))
        other = np.flatnonzero(capture.setpoints.of_steps(count) != self._setpoint)
        if len(other):
            ends.append((int(other[0]), f"the setpoint of step {other[0]} did not reach the board in time"))
        ends += self._other_tables()
        return min(ends, key=lambda end: end[0])

    def _other_tables(self) -> list[tuple[int, str]]:
        """The first step that may have used another table than the one that was meant for it."""
        used = [(one.step, one.crc32, one.announced) for one in self._capture.tables.changes]
        meant = [(one.step, one.crc32, True) for one in self._tables]
        for place, table in enumerate(meant):
            if place == len(used):
                return [(table[0], f"the board did not say that step {table[0]} used the other parameters")]
            if used[place] != table:
                first = min(table[0], max(used[place][0], 0))
                return [(first, f"the other parameters of step {table[0]} were not in use from this very step on")]
        more = used[len(meant) :]
        return [(max(more[0][0], 0), f"other parameters were committed about step {more[0][0]}")] if more else []


def _tables_of(before: Sequence[int], changes: Changes) -> list[_Table]:
    """The whole table of each change: that of the beginning with another control part."""
    return [_Table(change.step, _with_control(before, change.params)) for change in changes]


def _with_control(before: Sequence[int], params: ControlParams) -> tuple[int, ...]:
    control = iter(params.words())
    rows = zip(parameters.table(), before, strict=True)
    return tuple(int(next(control)) if row.owner == "control" else word for row, word in rows)

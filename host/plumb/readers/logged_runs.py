"""The runs in a recording of frames: what is known of each, and its steps, in parts or together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.readers.log_file import Frames
from plumb.readers.run_parts import PER_STEP, RunReader, RunState, Signal, Steps, TableFrame, Values
from plumb.spec.arrays import BoolArray
from plumb.spec.protocol import Protocol

__all__ = ["LoggedRun", "Steps", "TableFrame", "runs_in"]

MOST_RUNS = 10_000
SPARSE_STEPS, MOST_STEPS_PER_FRAME = 1 << 20, 64
"""Most steps of a recording: so many, and so many more for each frame. A STEP that jumps ahead stands for steps that
did not arrive, up to 4096 (LONGEST_GAP): without a limit a few megabytes of them are a run of days."""

Blocks = Callable[[], Iterable[Frames]]
"""Reads the frames of a recording from its beginning, block by block."""


@dataclass(frozen=True)
class LoggedRun:
    """One run. The arrays are those of all its steps together, which `parts` gives without holding them all.

    at: place of its first frame among all frames of the recording; end: place after its last. first: number of its
    first step; steps: how many there are. raw_frames: the RAW frames that were received. raw_missing, digest_missing:
    how many steps come before the first one without. incomplete: steps without their digest, or, where raw counts were
    sent, without those. setpoint_doubt: the first step whose setpoint is not known. signals: those that came. begin_us:
    when the first STEP that came was received, and its number. lost: gaps in the counters of the other frames.
    table_frames: those that carry parameters (`plumb.link.used_tables`); marks: for places of the recording, the step
    after the last STEP before.
    """

    at: int
    end: int
    first: int
    steps: int
    raw_frames: tuple[str, ...]
    raw_missing: int | None
    digest_missing: int | None
    incomplete: int
    setpoint_doubt: int | None
    signals: tuple[Signal, ...]
    begin_us: tuple[int, int]
    lost: int
    table_frames: tuple[TableFrame, ...]
    marks: dict[int, int]
    read: Callable[[], Iterator[Steps]]

    def parts(self, most: int | None = None) -> Iterator[Steps]:
        """Its steps in order, in parts of a bounded size. most: only so many steps from the first on."""
        left = self.steps if most is None else min(most, self.steps)
        if not left:
            return
        for part in self.read():
            yield part.cut(left) if len(part) > left else part
            left -= len(part)
            if left <= 0:
                return

    def known_until(self) -> int:
        """Number of steps from the first on whose inputs all arrived; 0 for a run whose beginning is missing."""
        ends = [end for end in (self.raw_missing, self.setpoint_doubt) if end is not None]
        return 0 if self.first else min([self.steps, *ends])

    def first_steps(self, count: int) -> LoggedRun:
        """The first `count` steps."""
        return replace(self, steps=min(count, self.steps))

    @cached_property
    def together(self) -> Steps:
        """All its steps, in memory."""
        parts = list(self.parts())
        raw, raw_known, digest, digest_known, armed, time_us, setpoint = (
            np.concatenate([getattr(part, name) for part in parts]) for name in PER_STEP
        )
        values = {signal: _together(signal, parts) for signal in self.signals}
        return Steps(self.first, raw, raw_known, digest, digest_known, armed, time_us, setpoint, values)

    @property
    def raw(self) -> npt.NDArray[np.int16]:
        return self.together.raw

    @property
    def raw_known(self) -> BoolArray:
        return self.together.raw_known

    @property
    def digest(self) -> npt.NDArray[np.uint32]:
        return self.together.digest

    @property
    def digest_known(self) -> BoolArray:
        return self.together.digest_known

    @property
    def armed(self) -> BoolArray:
        return self.together.armed

    @property
    def setpoint(self) -> npt.NDArray[np.int32]:
        return self.together.setpoint

    @property
    def values(self) -> dict[Signal, Values]:
        return self.together.values


def _together(signal: Signal, parts: list[Steps]) -> Values:
    """The values of a signal in all parts; 0 where it did not come."""
    found = [part.signal(signal) for part in parts]
    return np.concatenate([value for value, _ in found]), np.concatenate([came for _, came in found])


class _Tally:
    """Counts the steps of one run while its parts go by."""

    def __init__(self, state: RunState) -> None:
        self.state, self.steps = state, 0
        self._without = {True: 0, False: 0}  # incomplete steps: where raw counts are needed, where not
        self.raw_missing: int | None = None
        self.digest_missing: int | None = None
        self.begin_us = (0, 0)
        self.signals: dict[Signal, None] = {}
        self._seen = False
        self._last_whole = {True: False, False: False}

    def add(self, part: Steps) -> None:
        if self.raw_missing is None and not part.raw_known.all():
            self.raw_missing = self.steps + int(np.argmin(part.raw_known))
        if self.digest_missing is None and not part.digest_known.all():
            self.digest_missing = self.steps + int(np.argmin(part.digest_known))
        if not self._seen and part.digest_known.any():
            here = int(np.argmax(part.digest_known))
            self._seen, self.begin_us = True, (int(part.time_us[here]), part.first + here)
        for with_raw in (True, False):
            whole = part.digest_known & part.raw_known if with_raw else part.digest_known
            self._without[with_raw] += int(np.count_nonzero(~whole))
            self._last_whole[with_raw] = bool(whole[-1])
        self.signals |= dict.fromkeys(part.values)
        self.steps += len(part)

    @property
    def incomplete(self) -> int:
        return self._without[bool(self.state.raw_frames)]

    def drop_open_end(self) -> None:
        """Leave out a last step of which only some frames came, because the recording ends in it."""
        with_raw = bool(self.state.raw_frames)
        if self._last_whole[with_raw] or self.steps < 2:
            return
        self.steps -= 1
        self._without[with_raw] -= 1
        self.raw_missing = None if self.raw_missing == self.steps else self.raw_missing
        self.digest_missing = None if self.digest_missing == self.steps else self.digest_missing


def runs_in(
    blocks: Blocks, messages: Protocol, needed_of: Callable[[int], tuple[str, ...]], marks: Iterable[int] = ()
) -> list[LoggedRun]:
    """All runs of a recording in order. needed_of, marks: as RunReader has them. The recording is read once for this,
    and again when a run's steps are asked for.

    Raises UsageError for more runs, or steps, than its frames can carry.
    """
    found: list[_Tally] = []
    steps = 0
    for state, part in RunReader(messages, needed_of, marks).parts(blocks()):
        if not found or found[-1].state is not state:
            found.append(_Tally(state))
        found[-1].add(part)
        steps += len(part)
        if len(found) > MOST_RUNS:
            raise UsageError(f"this recording holds more than {MOST_RUNS} runs: record them in several files")
        if steps > SPARSE_STEPS + MOST_STEPS_PER_FRAME * state.end:
            raise UsageError(
                f"this recording lacks all but a few frames of its {steps} steps and more: give an undamaged copy"
            )

    def reader(number: int) -> Callable[[], Iterator[Steps]]:
        def read() -> Iterator[Steps]:
            for state, part in RunReader(messages, needed_of).parts(blocks()):
                if state.number == number:
                    yield part
                elif state.number > number:
                    return

        return read

    for tally in found:
        tally.drop_open_end()
    return [_run_of(tally, reader(tally.state.number)) for tally in found]


def _run_of(tally: _Tally, read: Callable[[], Iterator[Steps]]) -> LoggedRun:
    state = tally.state
    return LoggedRun(
        at=state.at,
        end=state.end,
        first=state.first,
        steps=tally.steps,
        raw_frames=tuple(sorted(state.raw_frames)),
        raw_missing=tally.raw_missing,
        digest_missing=tally.digest_missing,
        incomplete=tally.incomplete,
        setpoint_doubt=state.reports.doubt,
        signals=tuple(tally.signals),
        begin_us=tally.begin_us,
        lost=state.lost,
        table_frames=tuple(state.table_frames),
        marks=state.marks,
        read=read,
    )

"""Find the runs in a recording of frames, block by block: the steps of each run in parts, in bounded memory.

A run begins where the board accepts RUN_BEGIN, or, where that frame is missing, at a step number that goes back to 0.
The steps count from the start of the run, unwrapped from the 16 bits of STEP; the other frames of a step carry the low
bits of its number and follow its STEP. A step is given out when so many others have followed that none of its frames
comes any more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from plumb.errors import UsageError
from plumb.link.realtime import SetpointReports
from plumb.link.selection import RAW_FRAMES
from plumb.link.transports.slcan import crc8_columns
from plumb.link.used_tables import TABLE_MESSAGES
from plumb.readers.log_file import ERROR, EXTENDED, FRAME, REMOTE, Frames
from plumb.spec import dbc
from plumb.spec.arrays import BoolArray
from plumb.spec.protocol import FRAME_DLC, Message, Protocol

Integers = npt.NDArray[np.int64]
Signal = tuple[str, str]
"""(frame, signal)."""
Values = tuple[Integers, BoolArray]
"""Raw integers, and which of them came."""

REPEATED = 16
"""In lockstep a STEP may be repeated for the last so many steps: no new run."""
RESTART_GAP = 64
"""A STEP of number 0 that far from the one before is a new run, whose RUN_BEGIN is missing."""
LONGEST_GAP = 4096
"""A STEP that far ahead of the one before begins a part of its own, whose beginning is missing."""
SETTLED = 64
"""Steps after which all frames of a step have come: the step number in RAW has six bits."""
WINDOW_FRAMES = 1 << 16
"""Frames that are sorted together."""
PART_STEPS = 1 << 15
"""Most steps of a part."""
MOST_TABLE_FRAMES = 1 << 18
"""Most frames of one run that carry parameters: its whole table, read a thousand times."""
_UNNUMBERED = ("STEP", "SAMPLE_A", "SAMPLE_B", "SETPOINT", *RAW_FRAMES)
"""Messages whose counter is a step number, or that the board does not send."""


class TableFrame(NamedTuple):
    """A frame of `TABLE_MESSAGES` in a run. at: its place among all frames; next_step: after the STEP before it."""

    at: int
    next_step: int
    identifier: int
    data: bytes


@dataclass(frozen=True)
class Steps:
    """Consecutive steps of a run, from number `first` on. All arrays (n,), raw (n, 6 or more) with room for the inputs
    of any system; a value that did not arrive is 0. raw_known: whether all of a step's RAW frames came; time_us: when
    its STEP was received; values: of the signals that came, raw integers, and which."""

    first: int
    raw: npt.NDArray[np.int16]
    raw_known: BoolArray
    digest: npt.NDArray[np.uint32]
    digest_known: BoolArray
    armed: BoolArray
    time_us: Integers
    setpoint: npt.NDArray[np.int32]
    values: dict[Signal, Values]

    def signal(self, signal: Signal) -> Values:
        """A signal of the run, whether it came in this part or not."""
        missing = np.zeros(len(self), np.int64), np.zeros(len(self), np.bool_)
        return self.values.get(signal, missing)

    def cut(self, count: int) -> Steps:
        """The first `count` steps."""
        values = {signal: (value[:count], came[:count]) for signal, (value, came) in self.values.items()}
        return replace(self, values=values, **{name: getattr(self, name)[:count] for name in PER_STEP})

    def __len__(self) -> int:
        return len(self.raw)


PER_STEP = ("raw", "raw_known", "digest", "digest_known", "armed", "time_us", "setpoint")


@dataclass
class RunState:
    """State of a run in addition to its steps. at: place of its first frame among all frames; end: after its last.
    needed: the RAW frames that its steps need; raw_frames: those that were received; lost: gaps in the counters of
    other frames; marks: for places that were asked for, the step after the last STEP before."""

    number: int
    at: int
    needed: tuple[str, ...]
    first: int = 0
    end: int = 0
    raw_frames: set[str] = field(default_factory=set)
    reports: SetpointReports = field(default_factory=SetpointReports)
    table_frames: list[TableFrame] = field(default_factory=list)
    lost: int = 0
    marks: dict[int, int] = field(default_factory=dict)
    counters: dict[int, int] = field(default_factory=dict)
    emitted: int = -1
    last: int = -1


class _Sorted(NamedTuple):
    """Frames of one message: their places among all, their data (n, 8), and when they were received."""

    at: Integers
    data: npt.NDArray[np.uint8]

    def words(self, message: Message) -> dict[str, Integers]:
        """The words of these frames by name, as raw integers."""
        codes = message.layout.format.removeprefix("<BB")
        kinds = {"H": "<u2", "h": "<i2", "I": "<u4", "i": "<i4"}
        words = ((name, kinds[code]) for name, code in zip(message.words, codes, strict=True))
        layout = np.dtype([("head", "u1", (2,)), *words])
        records = np.ascontiguousarray(self.data).view(layout).reshape(-1)
        return {name: records[name].astype(np.int64) for name in message.words}

    def flag(self, message: Message, name: str) -> Integers:
        shift, width = message.flags[name]
        return self.data[:, 1].astype(np.int64) >> (4 + shift) & (1 << width) - 1


@dataclass(frozen=True)
class _Window:
    """Good frames with their places, and the STEP frames among them with their numbers in their runs."""

    at: Integers
    frames: Frames
    step_at: Integers
    numbers: Integers

    def cut(self, begin: int, end: int) -> _Window:
        """The frames at [begin, end)."""
        part = slice(*np.searchsorted(self.at, (begin, end)))
        steps = slice(*np.searchsorted(self.step_at, (begin, end)))
        return _Window(self.at[part], self.frames[part], self.step_at[steps], self.numbers[steps])

    def of(self, identifier: int) -> _Sorted:
        chosen = self.frames["can_id"] == identifier
        return _Sorted(self.at[chosen], self.frames["data"][chosen])

    def steps(self, at: Integers, low: Integers, bits: int) -> Integers:
        """The steps of frames that carry the low bits of their step: the nearest to the STEP before them."""
        last = self.numbers[np.maximum(np.searchsorted(self.step_at, at) - 1, 0)]
        half = 1 << bits - 1
        return last + ((low - last + half) & (1 << bits) - 1) - half

    def next_after(self, at: int) -> int:
        """The step after the last one that was received before a place."""
        place = int(np.searchsorted(self.step_at, at))
        return int(self.numbers[place - 1]) + 1 if place else int(self.numbers[0])


class RunReader:
    """Follows the runs of a recording. needed_of: place of a run's first frame -> the RAW frames that carry the counts
    of its steps; marks: places for which a run says its step. `parts` gives the steps with the run that they are of; a
    run has all that is known of it when the next run's steps come, or at the end."""

    def __init__(
        self, messages: Protocol, needed_of: Callable[[int], tuple[str, ...]], marks: Iterable[int] = ()
    ) -> None:
        self._messages, self._needed_of, self._marks = messages, needed_of, sorted(marks)
        self._known = np.array(sorted(messages.by_identifier), np.uint32)
        self._step, self._ack = messages["STEP"], messages["ACK"]
        self._system_ids = [i for i in messages.by_identifier if dbc.of_system(i)]
        self._raw = [name for name in RAW_FRAMES if name in messages.messages]
        numbered = [self._step.identifier, *(messages[name].identifier for name in self._raw), *self._system_ids]
        self._numbered = np.array(numbered, np.uint32)
        self._table_ids = [messages[name].identifier for name in TABLE_MESSAGES if name in messages.messages]
        self._run: RunState | None = None
        self._count = self._seen = self._runs = 0
        self._at, self._frames = np.zeros(0, np.int64), np.zeros(0, FRAME)
        self._first_number = 0

    def parts(self, blocks: Iterable[Frames]) -> Iterator[tuple[RunState, Steps]]:
        """The steps of all runs in order."""
        waiting: list[Frames] = []
        frames = 0
        for block in blocks:
            waiting.append(block)
            frames += len(block)
            if frames >= WINDOW_FRAMES:
                yield from self._take(np.concatenate(waiting), at_end=False)
                waiting, frames = [], 0
        yield from self._take(np.concatenate(waiting) if waiting else np.zeros(0, FRAME), at_end=True)

    # ---- one window ----

    def _take(self, frames: Frames, *, at_end: bool) -> Iterator[tuple[RunState, Steps]]:
        """Sort new frames behind those that were kept, and give out the steps that are settled."""
        plain = (frames["can_id"] & (EXTENDED | REMOTE | ERROR)) == 0
        good = plain & np.isin(frames["can_id"], self._known)
        good[good] = _crc_right(frames[good])
        at = np.concatenate([self._at, self._count + np.flatnonzero(good)])
        kept = np.concatenate([self._frames, frames[good]])
        self._count += len(frames)
        steps = kept["can_id"] == self._step.identifier
        step_at = at[steps]
        if not len(step_at):
            self._keep(at, kept, self._last_begin(at, kept, -1))
            return
        begins, numbers = self._numbers(at, kept, step_at, kept["data"][steps])
        window = _Window(at, kept, step_at, numbers)
        starts = [self._begun_before(at, kept, int(step_at[b]), int(step_at[b - 1]) if b else -1) for b in begins]
        first_at = int(at[0]) if self._run is not None else None
        bounds = [*([first_at] if first_at is not None else []), *starts]
        for index, start in enumerate(bounds):
            final = index + 1 < len(bounds)
            if self._run is None or index or start != first_at:
                self._run = self._begin(start)
            end = bounds[index + 1] if final else self._open_end(at, kept, int(step_at[-1]))
            yield from self._emit(self._run, window.cut(start, end), end, final=final or at_end)
        self._retain(window)

    def _numbers(
        self, at: Integers, kept: Frames, step_at: Integers, data: npt.NDArray[np.uint8]
    ) -> tuple[list[int], Integers]:
        """Which STEP frames begin a run, and the number of each in its run."""
        low = _Sorted(step_at, data).words(self._step)["step"]
        ahead = np.diff(low).astype(np.int16).astype(np.int64)
        restart = (low[1:] == 0) & ((ahead < 0) | (ahead > RESTART_GAP)) | (ahead < -REPEATED) | (ahead > LONGEST_GAP)
        acknowledged = np.searchsorted(step_at, self._begin_acks(at, kept))
        new = np.zeros(len(low), np.bool_)
        new[1:] = restart
        new[acknowledged[acknowledged < len(low)]] = True
        goes_on = self._run is not None
        new[0] = not goes_on
        begins = np.flatnonzero(new)
        segments = begins if not goes_on else np.concatenate([[0], begins])
        base = low[segments].copy()
        if goes_on:
            base[0] = self._first_number
        ahead = np.concatenate([[0], ahead])
        ahead[segments] = 0
        total, segment = np.cumsum(ahead), np.searchsorted(segments, np.arange(len(low)), "right") - 1
        return [int(begin) for begin in begins], total - total[segments][segment] + base[segment]

    def _begin_acks(self, at: Integers, kept: Frames) -> Integers:
        chosen = kept["can_id"] == self._ack.identifier
        ack = _Sorted(at[chosen], kept["data"][chosen])
        places: Integers = ack.at[ack.words(self._ack)["request"] == self._messages["RUN_BEGIN"].identifier]
        return places

    def _last_begin(self, at: Integers, kept: Frames, after: int) -> int | None:
        """Place of the last accepted RUN_BEGIN after a place."""
        acks = self._begin_acks(at, kept)
        acks = acks[acks > after]
        return int(acks[-1]) if len(acks) else None

    def _begun_before(self, at: Integers, kept: Frames, start: int, after: int) -> int:
        """Begin of the run whose first STEP is at `start`: at the ACK of its RUN_BEGIN, if that was received."""
        acks = self._begin_acks(at, kept)
        acks = acks[(acks > after) & (acks < start)]
        return int(acks[-1]) if len(acks) else start

    def _open_end(self, at: Integers, kept: Frames, last_step: int) -> int:
        """End so far of the frames of the run at hand: before the next accepted RUN_BEGIN, if there is one."""
        begin = self._last_begin(at, kept, last_step)
        return self._count if begin is None else begin

    def _begin(self, at: int) -> RunState:
        self._runs += 1
        self._seen = at
        return RunState(self._runs, at, self._needed_of(at))

    def _retain(self, window: _Window) -> None:
        """Keep what steps that are not given out yet may need, and what has not been looked at."""
        assert self._run is not None
        settled = np.flatnonzero(window.numbers >= self._run.emitted - SETTLED)
        inside = settled[window.step_at[settled] >= self._run.at]
        first = int(np.searchsorted(window.step_at, self._run.at))
        # Before the first STEP of a run there may be frames of a step whose STEP was lost.
        begin = self._run.at if inside[0] == first else int(window.step_at[inside[0]])
        self._first_number = int(window.numbers[inside[0]])
        wanted = np.isin(window.frames["can_id"], self._numbered) | (window.at >= self._seen)
        wanted &= window.at >= begin
        self._at, self._frames = window.at[wanted], window.frames[wanted]

    def _keep(self, at: Integers, kept: Frames, begin: int | None) -> None:
        """Without a STEP: only what follows an accepted RUN_BEGIN may belong to a run."""
        wanted = at >= (self._count if begin is None else begin)
        self._at, self._frames = at[wanted], kept[wanted]

    # ---- the steps of a run ----

    def _emit(self, run: RunState, window: _Window, end: int, *, final: bool) -> Iterator[tuple[RunState, Steps]]:
        """Give out the settled steps of a run, all of them when it is over."""
        fresh = window.cut(self._seen, end)
        run.end = end
        self._note(run, window, fresh)
        self._seen = end
        raw = {name: self._raw_of(name, window) for name in self._raw}
        run.raw_frames |= {name for name, (steps, _) in raw.items() if len(steps)}
        signals = {i: self._signals_of(i, window) for i in self._system_ids}
        numbered = [window.numbers, *(steps for steps, _ in raw.values()), *(steps for steps, _ in signals.values())]
        if run.emitted < 0:
            run.first = run.emitted = max(min(int(one.min()) for one in numbered if len(one)), 0)
        last = max(int(one.max()) for one in numbered if len(one))
        stop = last + 1 if final else int(window.numbers.max()) + 1 - SETTLED
        while run.emitted < stop:
            count = min(stop - run.emitted, PART_STEPS)
            part = self._part(run, window, raw, signals, count)
            run.emitted += count
            yield run, part

    def _note(self, run: RunState, window: _Window, fresh: _Window) -> None:
        """Facts about the whole run from frames that were not read before."""
        used = self._messages["SETPOINT_USED"]
        frames = fresh.of(used.identifier)
        for at, data in zip(frames.at.tolist(), frames.data, strict=True):
            run.reports.note(used.decode(data.tobytes()), max(window.next_after(at) - 1, int(window.numbers[0])))
        for place in np.flatnonzero(np.isin(fresh.frames["can_id"], self._table_ids)).tolist():
            if len(run.table_frames) == MOST_TABLE_FRAMES:
                raise UsageError(
                    f"a run of this recording holds more than {MOST_TABLE_FRAMES} frames of parameters, "
                    "which no host asks for: give an undamaged copy"
                )
            at, data = int(fresh.at[place]), fresh.frames["data"][place].tobytes()
            run.table_frames.append(TableFrame(at, window.next_after(at), int(fresh.frames["can_id"][place]), data))
        for mark in (mark for mark in self._marks if self._seen < mark <= run.end):
            run.marks[mark] = window.next_after(mark)
        for identifier in np.unique(fresh.frames["can_id"]).tolist():
            message = self._messages.by_identifier[identifier]
            if message.name not in _UNNUMBERED and message.sender == "BOARD":
                counter = fresh.of(identifier).data[:, 1].astype(np.int64) & 15
                before = run.counters.get(identifier, int(counter[0]) - 1)
                run.lost += int(((np.diff(counter, prepend=before) - 1) & 15).sum())
                run.counters[identifier] = int(counter[-1])

    def _raw_of(self, name: str, window: _Window) -> tuple[Integers, npt.NDArray[np.int16]]:
        message = self._messages[name]
        frames = window.of(message.identifier)
        words = frames.words(message)
        counts = np.stack([words[one] for one in message.words], 1).astype(np.int16)
        return window.steps(frames.at, frames.data[:, 1].astype(np.int64) & 63, 6), counts

    def _signals_of(self, identifier: int, window: _Window) -> tuple[Integers, _Sorted]:
        frames = window.of(identifier)
        return window.steps(frames.at, frames.data[:, 1].astype(np.int64) >> 4, 4), frames

    def _part(
        self, run: RunState, window: _Window, raw: dict[str, tuple[Integers, npt.NDArray[np.int16]]],
        signals: dict[int, tuple[Integers, _Sorted]], count: int,
    ) -> Steps:  # fmt: skip
        """The next `count` steps."""
        first = run.emitted
        counts, raw_known = np.zeros((count, 3 * len(RAW_FRAMES)), np.int16), np.ones(count, np.bool_)
        for name, (steps, values) in raw.items():
            offset = 3 * RAW_FRAMES.index(name)
            here, inside = _placed(steps, first, count)
            counts[here, offset : offset + 3] = values[inside]
            if name in run.needed:
                raw_known &= _came(here, count)
        step = window.of(self._step.identifier)
        here, inside = _placed(window.numbers, first, count)
        words = step.words(self._step)
        digest, armed, time_us = np.zeros(count, np.uint32), np.zeros(count, np.bool_), np.zeros(count, np.int64)
        digest[here] = words["digest"][inside].astype(np.uint32)
        armed[here] = step.flag(self._step, "armed")[inside] != 0
        time_us[here] = window.frames["time_us"][np.searchsorted(window.at, window.step_at)][inside]
        setpoint = run.reports.of_steps(first + count, first)
        signalled = dict(self._values(signals, first, count))
        return Steps(first, counts, raw_known, digest, _came(here, count), armed, time_us, setpoint, signalled)

    def _values(
        self, signals: dict[int, tuple[Integers, _Sorted]], first: int, count: int
    ) -> Iterator[tuple[Signal, Values]]:
        for identifier, (steps, frames) in signals.items():
            if not len(steps):
                continue
            here, inside = _placed(steps, first, count)
            came, message = _came(here, count), self._messages.by_identifier[identifier]
            for signal, values in frames.words(message).items():
                if not signal.startswith("reserved"):
                    whole = np.zeros(count, np.int64)
                    whole[here] = values[inside]
                    yield (message.name, signal), (whole, came)


def _placed(steps: Integers, first: int, count: int) -> tuple[Integers, BoolArray]:
    """Indices in the arrays of a part, and which frames have one."""
    inside = (steps >= first) & (steps < first + count)
    return steps[inside] - first, inside


def _came(here: Integers, count: int) -> BoolArray:
    came = np.zeros(count, np.bool_)
    came[here] = True
    return came


def _crc_right(frames: Frames) -> BoolArray:
    """Which frames have eight bytes and the right CRC-8."""
    entry = np.zeros((len(frames), 10), np.uint8)
    identifier = frames["can_id"].astype(np.int64)
    entry[:, 0], entry[:, 1] = identifier >> 4, (identifier << 4 | FRAME_DLC) & 0xFF
    entry[:, 2:] = frames["data"]
    right = np.frombuffer(crc8_columns(entry.tobytes()), np.uint8) if len(frames) else np.zeros(0, np.uint8)
    return np.asarray((frames["length"] == FRAME_DLC) & (right == frames["data"][:, 0]), np.bool_)

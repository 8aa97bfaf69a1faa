"""The runs in a recording of frames: raw counts, digest, setpoint and signals of every step.

A run begins where the board accepts RUN_BEGIN, or, where that was not heard, at a step number that goes back to 0. The
steps count from the start of the run, unwrapped from the 16 bits of STEP; the other frames of a step carry the low bits
of its number and follow its STEP.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from plumb.inputs.log_file import ERROR, EXTENDED, REMOTE, Frames
from plumb.link.realtime import SetpointReports
from plumb.link.transports.slcan import crc8_columns
from plumb.link.used_tables import TABLE_MESSAGES
from plumb.spec import dbc
from plumb.spec.arrays import BoolArray
from plumb.spec.protocol import FRAME_DLC, Message, Protocol

Integers = npt.NDArray[np.int64]

REPEATED = 16
"""In lockstep a STEP may be repeated for the last so many steps: no new run."""
RESTART_GAP = 64
"""A STEP of number 0 that far from the one before is a new run, whose RUN_BEGIN was not heard."""
_UNNUMBERED = ("STEP", "RAW_A", "RAW_B", "SAMPLE_A", "SAMPLE_B", "SETPOINT")
"""Messages whose counter is a step number, or that the board does not send."""


_PER_STEP = ("raw", "raw_known", "digest", "digest_known", "armed", "place", "time_us", "setpoint")
LONGEST_GAP = 4096
"""A STEP that far ahead of the one before begins a part of its own, whose beginning is missing."""


class TableFrame(NamedTuple):
    """A frame of `TABLE_MESSAGES` in a run. at: its place among all frames; next_step: after the STEP before it."""

    at: int
    next_step: int
    identifier: int
    data: bytes


@dataclass(frozen=True)
class LoggedRun:
    """One run; n steps from number `first` on. All arrays (n,), raw (n, 6); a value that did not arrive is 0.

    at: place of its first frame among all frames of the recording; end: place after its last. raw_known, digest_known:
    steps whose counts and digest arrived; raw_frames: the RAW frames that were heard. setpoint_doubt: the first step
    whose setpoint is not known. values: (frame, signal) -> raw integers, and which arrived. place: of each STEP among
    all frames, and time_us, when it was received. lost: gaps in the counters of the other frames. table_frames: those
    that tell of parameters (`plumb.link.used_tables`).
    """

    at: int
    end: int
    first: int
    raw: npt.NDArray[np.int16]
    raw_known: BoolArray
    raw_frames: tuple[str, ...]
    digest: npt.NDArray[np.uint32]
    digest_known: BoolArray
    armed: BoolArray
    place: Integers
    time_us: Integers
    setpoint: npt.NDArray[np.int32]
    setpoint_doubt: int | None
    values: dict[tuple[str, str], tuple[Integers, BoolArray]] = field(default_factory=dict)
    lost: int = 0
    table_frames: tuple[TableFrame, ...] = ()

    @property
    def steps(self) -> int:
        return len(self.raw)

    @property
    def incomplete(self) -> int:
        """Steps without their digest, or, where raw counts were sent, without those."""
        whole = self.digest_known & self.raw_known if self.raw_frames else self.digest_known
        return int(np.count_nonzero(~whole))

    def known_until(self) -> int:
        """Number of steps from the first on whose inputs all arrived; 0 for a run whose beginning is missing."""
        if self.first != 0:
            return 0
        missing = np.flatnonzero(~self.raw_known)
        ends = [self.steps, *(int(step) for step in missing[:1])]
        return min(ends if self.setpoint_doubt is None else [*ends, self.setpoint_doubt])

    def steps_before(self, place: int) -> int:
        """Number of steps that had been received before a place in the recording."""
        received = np.flatnonzero(self.digest_known & (self.place < place))
        return int(received[-1]) + 1 if len(received) else 0

    def without_open_end(self) -> LoggedRun:
        """The run without a last step of which only some frames came, because the recording ends in it."""
        whole = self.digest_known[-1] and (self.raw_known[-1] or not self.raw_frames)
        return self if whole or self.steps < 2 else self.first_steps(self.steps - 1)

    def first_steps(self, count: int) -> LoggedRun:
        """The first `count` steps."""
        values = {signal: (value[:count], came[:count]) for signal, (value, came) in self.values.items()}
        return replace(self, values=values, **{name: getattr(self, name)[:count] for name in _PER_STEP})


@dataclass(frozen=True)
class _Sorted:
    """The frames of one message: their places among all, and their data, (n, 8)."""

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


class RunFinder:
    """Sorts a recording's frames by message, and finds its runs. rejected: frames of this protocol with a wrong CRC;
    foreign: frames of others."""

    def __init__(self, frames: Frames, messages: Protocol) -> None:
        self._messages = messages
        plain = (frames["can_id"] & (EXTENDED | REMOTE | ERROR)) == 0
        known = plain & np.isin(frames["can_id"], list(messages.by_identifier))
        good = known.copy()
        good[known] = _crc_right(frames[known])
        self.rejected, self.foreign = int((known & ~good).sum()), int((~known).sum())
        self._at = np.flatnonzero(good)
        self._frames = frames[self._at]
        self._time_us = frames["time_us"]

    def _of(self, name: str) -> _Sorted:
        chosen = self._frames["can_id"] == self._messages[name].identifier
        return _Sorted(self._at[chosen], self._frames["data"][chosen])

    def runs(self, raw_frames: tuple[str, ...]) -> list[LoggedRun]:
        """All runs in order. raw_frames: those that carry the counts of a step."""
        step = self._of("STEP")
        if not len(step.at):
            return []
        begins, numbers = self._numbered(step)
        ends = [*begins[1:], len(step.at)]
        starts = [int(step.at[begin]) for begin in begins]
        found = []
        for index, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            first_at = self._begun_before(starts[index], int(step.at[begin - 1]) if begin else -1)
            following = starts[index + 1] if index + 1 < len(starts) else len(self._time_us)
            last_at = following if index + 1 == len(starts) else self._begun_before(following, int(step.at[end - 1]))
            part = _Sorted(step.at[begin:end], step.data[begin:end])
            found.append(self._run(part, numbers[begin:end], first_at, last_at, raw_frames))
        return found

    def _begun_before(self, start: int, after: int) -> int:
        """Where the run whose first STEP is at `start` begins: at the ACK of its RUN_BEGIN, if that was heard."""
        acks = self._begin_acks[(self._begin_acks > after) & (self._begin_acks < start)]
        return int(acks[-1]) if len(acks) else start

    def _numbered(self, step: _Sorted) -> tuple[list[int], Integers]:
        """The first STEP of every run, and the number of every STEP in its run."""
        ack, message = self._of("ACK"), self._messages["ACK"]
        of_begin = ack.words(message)["request"] == self._messages["RUN_BEGIN"].identifier
        self._begin_acks = ack.at[of_begin]
        low = step.words(self._messages["STEP"])["step"]
        ahead = np.diff(low).astype(np.int16).astype(np.int64)
        restart = (low[1:] == 0) & ((ahead < 0) | (ahead > RESTART_GAP)) | (ahead < -REPEATED) | (ahead > LONGEST_GAP)
        acknowledged = np.searchsorted(step.at, self._begin_acks)
        new = np.zeros(len(low), np.bool_)
        new[1:] = restart
        new[acknowledged[acknowledged < len(low)]] = True
        new[0] = True
        begins = np.flatnonzero(new)
        ahead = np.concatenate([[0], ahead])
        ahead[begins] = 0
        total = np.cumsum(ahead)
        run = np.cumsum(new) - 1
        return [int(begin) for begin in begins], total - total[begins][run] + low[begins][run]

    def _run(
        self, step: _Sorted, numbers: Integers, first_at: int, last_at: int, raw_frames: tuple[str, ...]
    ) -> LoggedRun:
        """The run whose frames are at [first_at, last_at). raw_frames: those that a step needs."""
        places = _Places(step.at, numbers, first_at, last_at)
        raw = {name: self._raw_of(name, places) for name in ("RAW_A", "RAW_B")}
        heard = tuple(name for name, (steps, _) in raw.items() if len(steps))
        signals = {name: self._part(name, places) for name in self._system_frames()}
        numbered = [numbers, *(steps for steps, _ in raw.values()), *(steps for steps, _ in signals.values())]
        first = max(min(int(one.min()) for one in numbered if len(one)), 0)
        count = max(int(one.max()) for one in numbered if len(one)) + 1 - first
        counts, raw_known = np.zeros((count, 6), np.int16), np.ones(count, np.bool_)
        for name, (steps, values) in raw.items():
            offset = 3 * (name == "RAW_B")
            here, kept = _placed(steps, first)
            counts[here, offset : offset + 3] = values[kept]
            if name in raw_frames:
                came = np.zeros(count, np.bool_)
                came[here] = True
                raw_known &= came
        words, message = step.words(self._messages["STEP"]), self._messages["STEP"]
        digest, known, armed = np.zeros(count, np.uint32), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        place, time_us = np.zeros(count, np.int64), np.zeros(count, np.int64)
        digest[numbers - first], known[numbers - first] = words["digest"].astype(np.uint32), True
        armed[numbers - first] = step.flag(message, "armed") != 0
        place[numbers - first], time_us[numbers - first] = step.at, self._time_us[step.at]
        reports = self._setpoints(places)
        return LoggedRun(
            first_at, last_at, first, counts, raw_known, heard, digest, known, armed, place, time_us,
            reports.of_steps(first + count)[first:], reports.doubt,
            dict(self._values(signals, first, count)), self._gaps(first_at, last_at), self._table_frames(places),
        )  # fmt: skip

    def _system_frames(self) -> Iterator[str]:
        ids = np.unique(self._frames["can_id"])
        return (self._messages.by_identifier[int(i)].name for i in ids if dbc.of_system(int(i)))

    def _part(self, name: str, places: _Places) -> tuple[Integers, _Sorted]:
        """The steps of a system's frames in a run, and the frames."""
        frames = places.cut(self._of(name))
        return places.steps(frames.at, frames.data[:, 1].astype(np.int64) >> 4, 4), frames

    def _raw_of(self, name: str, places: _Places) -> tuple[Integers, npt.NDArray[np.int16]]:
        frames = places.cut(self._of(name))
        words = frames.words(self._messages[name])
        counts = np.stack([words[one] for one in self._messages[name].words], 1).astype(np.int16)
        return places.steps(frames.at, frames.data[:, 1].astype(np.int64) & 63, 6), counts

    def _values(
        self, signals: dict[str, tuple[Integers, _Sorted]], first: int, count: int
    ) -> Iterator[tuple[tuple[str, str], tuple[Integers, BoolArray]]]:
        for name, (steps, frames) in signals.items():
            here, kept = _placed(steps, first)
            came = np.zeros(count, np.bool_)
            came[here] = True
            for signal, values in frames.words(self._messages[name]).items():
                if not signal.startswith("reserved"):
                    whole = np.zeros(count, np.int64)
                    whole[here] = values[kept]
                    yield (name, signal), (whole, came)

    def _setpoints(self, places: _Places) -> SetpointReports:
        message, reports = self._messages["SETPOINT_USED"], SetpointReports()
        frames = places.cut(self._of("SETPOINT_USED"))
        for at, data in zip(frames.at, frames.data, strict=True):
            reports.note(message.decode(data.tobytes()), places.last_before(int(at)))
        return reports

    def _table_frames(self, places: _Places) -> tuple[TableFrame, ...]:
        known = [self._messages[name].identifier for name in TABLE_MESSAGES if name in self._messages.messages]
        chosen = np.isin(self._frames["can_id"], known)
        frames = places.cut(_Sorted(self._at[chosen], self._frames["data"][chosen]))
        identifiers = self._frames["can_id"][np.searchsorted(self._at, frames.at)]
        rows = zip(frames.at.tolist(), identifiers.tolist(), frames.data, strict=True)
        return tuple(TableFrame(at, places.next_after(at), identifier, data.tobytes()) for at, identifier, data in rows)

    def _gaps(self, first_at: int, last_at: int) -> int:
        """Frames that are missing by the counters of the messages that have a counter of their own."""
        lost = 0
        inside = (self._at >= first_at) & (self._at < last_at)
        frames = self._frames[inside]
        for identifier in np.unique(frames["can_id"]):
            message = self._messages.by_identifier[int(identifier)]
            if message.name not in _UNNUMBERED and message.sender == "BOARD":
                counter = frames["data"][frames["can_id"] == identifier][:, 1].astype(np.int64) & 15
                lost += int(((np.diff(counter) - 1) & 15).sum())
        return lost


class _Places:
    """Where the steps of one run are among the frames. at, numbers: of its STEP frames."""

    def __init__(self, at: Integers, numbers: Integers, first_at: int, last_at: int) -> None:
        self._at, self._numbers, self._span = at, numbers, (first_at, last_at)

    def cut(self, frames: _Sorted) -> _Sorted:
        """Those of the frames that are in the run."""
        begin, end = np.searchsorted(frames.at, self._span)
        return _Sorted(frames.at[begin:end], frames.data[begin:end])

    def steps(self, at: Integers, low: Integers, bits: int) -> Integers:
        """The steps of frames that carry the low bits of their step: the nearest to the STEP before them."""
        before = np.maximum(np.searchsorted(self._at, at) - 1, 0)
        half = 1 << bits - 1
        last = self._numbers[before]
        return last + ((low - last + half) & (1 << bits) - 1) - half

    def next_after(self, at: int) -> int:
        """The step after the last one that was received before a place."""
        place = int(np.searchsorted(self._at, at))
        return int(self._numbers[place - 1]) + 1 if place else int(self._numbers[0])

    def last_before(self, at: int) -> int:
        return int(self._numbers[max(int(np.searchsorted(self._at, at)) - 1, 0)])


def _placed(steps: Integers, first: int) -> tuple[Integers, BoolArray]:
    """Indices in the arrays of a run, and which frames have one."""
    kept = steps >= first
    return steps[kept] - first, kept


def _crc_right(frames: Frames) -> BoolArray:
    """Which frames have eight bytes and the right CRC-8."""
    entry = np.zeros((len(frames), 10), np.uint8)
    identifier = frames["can_id"].astype(np.int64)
    entry[:, 0], entry[:, 1] = identifier >> 4, (identifier << 4 | FRAME_DLC) & 0xFF
    entry[:, 2:] = frames["data"]
    right = np.frombuffer(crc8_columns(entry.tobytes()), np.uint8) if len(frames) else np.zeros(0, np.uint8)
    return np.asarray((frames["length"] == FRAME_DLC) & (right == frames["data"][:, 0]), np.bool_)

"""The signals of every step of a run: rows of a ring, which every page reads at its own pace.

A row has a value for each column, NaN where the frame did not arrive. Signals that the link has no room for are those
of the integer model, in steps whose digest says that the board has the same bits. An attitude has columns of roll,
pitch and yaw, too. The ring keeps the newest ROWS_KEPT rows; a page that was away for longer misses the older ones, and
gets their number. Recordings do not pass through here.
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from plumb.link.monitor import QUATERNION
from plumb.link.realtime import Capture
from plumb.link.selection import RAW_FRAMES
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.quaternion_angles import ANGLES
from plumb.spec.signals import UNITS, signals
from plumb.spec.system import Command

T = TypeVar("T")

ROWS_KEPT = 1 << 15
"""65 s at 500 Hz."""
ROWS_PER_PIECE = 4000
"""Most rows in one message to a page."""
PIECE_HEADER = struct.Struct("<IIIIII")
"""Tick, number of the run, number of the first row, rows, columns, rows missed. Then time_s of the rows as float64, and
the rows as float32."""
LATE_STEPS = 1
"""A step's row is written when the next step has begun: by then all its frames have come, or never will."""
FORGOTTEN_STEPS = 64
"""Frames of a step that arrive when it is this old are dropped; the step number in a frame has no more than 6 bits."""


@dataclass(frozen=True)
class Column:
    """A column of the rows. name: with the unit at its end, as in a recording; unit: as the page shows it."""

    name: str
    unit: str


def columns_of(system: str, frames: tuple[str, ...]) -> list[Column]:
    """The columns of a run: the signals of the frames that are sent, then the raw counts."""
    ends = {end: unit for unit, end in UNITS.items()}
    found = []
    for (frame, _), name, _ in signals(system):
        if frame in frames and name != "flags":
            found.append(Column(name, next((unit for end, unit in ends.items() if name.endswith(end)), "")))
    found += [Column(name, "") for name in command_columns(system, frames)]
    return found + [Column(name, "count") for name in raw_columns(system, frames)]


def computed_signals(system: str, frames: set[str], names: Sequence[str]) -> list[tuple[int, str, float]]:
    """(place among the names, word of the record, value of one LSB) of the signals in these frames."""
    parts = {
        (f"{system.upper()}_{frame.name}", part.name): part
        for frame in declarations.system(system).frames
        for part in (frame.half, frame.word)
        if part is not None
    }
    return [
        (names.index(column), parts[signal].word.name, scale / 2.0 ** parts[signal].shift)
        for signal, column, scale in signals(system)
        if signal[0] in frames and column in names
    ]


def raw_columns(system: str, frames: tuple[str, ...]) -> list[str]:
    """Names of the columns of raw counts, in the order of the channels; [] where no frame carries them."""
    carried = _carried(frames)
    return [f"raw_{channel.name}" for channel in declarations.system(system).channels[:carried]]


def command_columns(system: str, frames: tuple[str, ...]) -> dict[str, tuple[Command, int]]:
    """Columns of the commands that the frames carry: each with its command, and the place of its first word."""
    declared = declarations.system(system)
    carried = _carried(frames)
    places = zip(declared.step_commands, declared.command_places(), strict=True)
    return {f"command_{one.name}": (one, at) for one, at in places if at + one.size <= carried}


def _carried(frames: tuple[str, ...]) -> int:
    """Number of inputs, from the first on, that the frames carry."""
    return 3 * len(set(RAW_FRAMES).intersection(frames))


class Samples:
    """The rows of one run. number: of the run; period_s: of a step; setpoint: a column for it, and units per LSB.
    Written by the board's thread, read by any."""

    def __init__(
        self,
        number: int,
        system: str,
        frames: tuple[str, ...],
        period_s: float,
        setpoint: tuple[Column, float] | None = None,
        computed: tuple[str, ...] = (),
    ) -> None:
        """computed: frames whose signals the model gives where the board does not send them."""
        self.number, self.system, self.period_s = number, system, period_s
        self.columns = columns_of(system, tuple({*frames, *computed}))
        if {column.name for column in self.columns}.issuperset(QUATERNION):
            self.columns = [*(Column(f"{angle}_deg", "deg") for angle in ANGLES), *self.columns]
        self._setpoint_at: int | None = None
        self._setpoint_scale = 0.0
        if setpoint is not None:
            column, self._setpoint_scale = setpoint
            self._setpoint_at = len(self.columns) - len(raw_columns(system, frames))
            self.columns.insert(self._setpoint_at, column)
        names = [column.name for column in self.columns]
        self._signals = [(signal, names.index(name), scale) for signal, name, scale in signals(system) if name in names]
        self._quaternion = [names.index(name) for name in QUATERNION] if set(QUATERNION) <= set(names) else []
        self._computed = computed_signals(system, set(computed).difference(frames), names)
        self._raw_at = len(names) - len(raw_columns(system, frames))
        self._commands = [
            (names.index(name), command, at) for name, (command, at) in command_columns(system, frames).items()
        ]
        self._time_s = np.zeros(ROWS_KEPT)
        self._values = np.zeros((ROWS_KEPT, len(names)), np.float32)
        self._lock = threading.Lock()
        self._next: int | None = None
        self.rows = 0
        self.words: Mapping[str, int] = {}
        """Of the newest step that the model has computed."""

    def take(self, capture: Capture, model: dict[int, Mapping[str, int]]) -> None:
        """Write the rows of the steps that are complete. model: words of steps by the integer model, which are used up.
        Raw counts and digests stay in the capture for FORGOTTEN_STEPS."""
        end = capture.steps - LATE_STEPS
        if self._next is None:
            if end <= 0:
                return
            self._next = max(0, min([*capture.digest, *capture.raw], default=end))
        setpoints = _by_step(capture, self._next, end) if self._setpoint_at is not None else ()
        for step in range(self._next, end):
            row = np.full(len(self.columns), math.nan, np.float32)
            for signal, at, scale in self._signals:
                value = capture.values.get(signal, {}).pop(step, None)
                if value is not None:
                    row[at] = value * scale
            words = model.pop(step, None)
            if words is not None:
                self.words = words
                for at, word, scale in self._computed:
                    row[at] = words[word] * scale
            if self._quaternion:
                row[: len(ANGLES)] = _angles_deg(row[self._quaternion])
            if self._setpoint_at is not None:
                row[self._setpoint_at] = setpoints[step - self._next] * self._setpoint_scale
            counts = capture.raw.get(step)
            if counts is not None:
                row[self._raw_at :] = counts[: len(row) - self._raw_at]
                for place, command, at in self._commands:
                    row[place] = command.value(counts[at : at + command.size])
            with self._lock:
                at = self.rows % ROWS_KEPT
                self._time_s[at], self._values[at] = step * self.period_s, row
                self.rows += 1
        self._next = max(self._next, end)
        _forget_steps(model, self._next - FORGOTTEN_STEPS)
        _forget(capture, self._next - FORGOTTEN_STEPS)

    def is_over(self, capture: Capture) -> bool:
        """Whether the step numbers went back: another run has begun, which another program began."""
        newest = next(reversed(capture.digest), None)
        return self._next is not None and newest is not None and newest < self._next - FORGOTTEN_STEPS

    def piece(self, first: int, tick: int) -> tuple[bytes, int]:
        """The rows from number `first` on as a message to a page, and the number after the last of them."""
        with self._lock:
            begin = max(first, self.rows - ROWS_KEPT, 0)
            end = min(self.rows, begin + ROWS_PER_PIECE)
            at = np.arange(begin, end) % ROWS_KEPT
            times, values = self._time_s[at].tobytes(), self._values[at].tobytes()
        head = PIECE_HEADER.pack(tick, self.number, begin, end - begin, len(self.columns), begin - first)
        return head + times + values, end

    def series(self, name: str, since_s: float) -> tuple[list[float], list[float]]:
        """Times and values of one column from a time on, without the steps that lack it."""
        index = [column.name for column in self.columns].index(name)
        with self._lock:
            at = np.arange(max(0, self.rows - ROWS_KEPT), self.rows) % ROWS_KEPT
            times, values = self._time_s[at], self._values[at, index].astype(np.float64)
        wanted = (times >= since_s) & np.isfinite(values)
        return times[wanted].tolist(), values[wanted].tolist()

    def newest(self) -> dict[str, float]:
        """The newest row by column, without what it lacks; {} before the first."""
        with self._lock:
            if not self.rows:
                return {}
            row = self._values[(self.rows - 1) % ROWS_KEPT].tolist()
        return {column.name: value for column, value in zip(self.columns, row, strict=True) if math.isfinite(value)}

    def raw_since(self, first: int, channels: int) -> tuple[FloatArray, int]:
        """The first raw counts of the rows from number `first` on, (rows, channels), NaN where they lack, and the
        number after the last of them."""
        return self._since(first, range(self._raw_at, min(self._raw_at + channels, len(self.columns))))

    def since(self, first: int, names: Sequence[str]) -> tuple[FloatArray, int]:
        """These columns of the rows from number `first` on, as `raw_since`."""
        columns = [column.name for column in self.columns]
        return self._since(first, [columns.index(name) for name in names])

    def _since(self, first: int, columns: Sequence[int]) -> tuple[FloatArray, int]:
        with self._lock:
            at = np.arange(max(first, self.rows - ROWS_KEPT, 0), self.rows) % ROWS_KEPT
            return self._values[at][:, list(columns)].astype(np.float64), self.rows

    @property
    def kept(self) -> int:
        """Rows that the ring holds at most."""
        return ROWS_KEPT

    @property
    def time_s(self) -> float:
        """Time of the newest row, 0 before the first."""
        with self._lock:
            return float(self._time_s[(self.rows - 1) % ROWS_KEPT]) if self.rows else 0.0


def _angles_deg(quaternion: npt.NDArray[np.float32]) -> list[float]:
    """Roll, pitch and yaw; NaN while a part is missing."""
    w, x, y, z = quaternion.astype(np.float64)
    return [float(np.degrees(angle(w, x, y, z))) for angle in ANGLES.values()]


def _by_step(capture: Capture, begin: int, end: int) -> list[float]:
    """The setpoint that each of these steps used; NaN where it is not known."""
    changes, known = capture.setpoints.changes, capture.setpoints.from_begin
    at = next((index for index in range(len(changes) - 1, 0, -1) if changes[index][0] <= begin), 0)
    found = list[float]()
    for step in range(begin, end):
        while at + 1 < len(changes) and changes[at + 1][0] <= step:
            at += 1
        found.append(changes[at][1] if at or known else math.nan)
    return found


def _forget(capture: Capture, before: int) -> None:
    """Drop what the capture still has of the steps below `before`, and its times."""
    capture.time_us.clear()
    _forget_steps(capture.raw, before)
    _forget_steps(capture.digest, before)
    for values in capture.values.values():
        _forget_steps(values, before)


def _forget_steps(by_step: dict[int, T], before: int) -> None:
    if len(by_step) > 2 * FORGOTTEN_STEPS:
        for step in [step for step in by_step if step < before]:
            del by_step[step]

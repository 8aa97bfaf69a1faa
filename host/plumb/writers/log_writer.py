"""Write a log (.plog) while its frames arrive. A killed recorder loses at most the last FLUSH_EVERY_S, a crash of the
machine at most that and SYNC_EVERY_S."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

import can

from plumb.files.block_file import BlockWriter
from plumb.link.frame_records import packed
from plumb.readers.log_file import (
    BLOCK_FRAMES,
    DBC_TEXT,
    DONE,
    FRAME,
    FRAMES,
    HEAD,
    MAGIC,
    PACK,
    PARAMETERS,
    SIMULATED,
    TRUTH,
    UTC,
)
from plumb.spec import dbc, parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.protocol import Frame

FLUSH_EVERY_S = 0.25
"""Longest time that frames wait for their block."""
SYNC_EVERY_S = 1.0
"""Interval at which what was written goes through to the disk."""
TRUTH_ROWS = 20
"""Times of one block of the truth."""
_BLOCK_BYTES = BLOCK_FRAMES * FRAME.itemsize


class LogWriter:
    """Writes one log. Frames wait until a block is full or FLUSH_EVERY_S has passed; `flush` looks at the time while
    none arrive.

    head: entries of the first block in addition to `clock`. simulated: the times that `add` gets count from the start
    of a simulated board, not from 1970. Raises UsageError when the file exists, unless `replace`, or cannot be written.
    """

    def __init__(
        self, path: Path, head: Mapping[str, object], *, simulated: bool = False, replace: bool = False
    ) -> None:
        self.path = path
        self._waiting = bytearray()
        self._truth: dict[str, list[float]] = {}
        self._flushed_s = time.monotonic()
        self._blocks = BlockWriter(path, MAGIC, replace=replace, sync_every_s=SYNC_EVERY_S)
        self._append_json(HEAD, {"clock": SIMULATED if simulated else UTC, **head})
        self._blocks.append(DBC_TEXT, dbc.text().encode("utf-8"))

    def _append_json(self, kind: str, value: Mapping[str, object]) -> None:
        self._blocks.append(kind, json.dumps(value, indent=1).encode("utf-8"))

    def parameters(self, words: Sequence[int]) -> None:
        """The whole table in use from here on, as Session.read_parameters gives it."""
        values = by_name(words)
        crc32 = parameters.crc32(words)
        self.flush(at_once=True)
        self._append_json(PARAMETERS, {"crc32": crc32, "count": len(words), "values": values})

    def parameters_changed(self, values: Mapping[str, int], step: int | None = None) -> None:
        """Parameters that have other values from here on. step: of the run, the first that used them."""
        self.flush(at_once=True)
        self._append_json(PARAMETERS, {"step": step, "values": dict(values)})

    def add(self, frames: Sequence[Frame], time_s: float, *, sent: bool = False) -> None:
        """Frames that were received, or sent, at one time."""
        time_us = round(time_s * 1e6)
        for identifier, data in frames:
            self._waiting += PACK(time_us, identifier, len(data), sent, data)
        self.flush()

    def truth(self, values: Mapping[str, float], time_s: float) -> None:
        """The true place of a simulated vehicle at a time of the clock of the frames: `true_height_m` and the like."""
        self._truth.setdefault("time_us", []).append(round(time_s * 1e6))
        for name, value in values.items():
            self._truth.setdefault(name, []).append(float(value))
        if len(self._truth["time_us"]) >= TRUTH_ROWS:
            self._write_truth()

    def _write_truth(self) -> None:
        if self._truth:
            self._append_json(TRUTH, self._truth)
            self._truth = {}

    def add_message(self, message: can.Message) -> None:
        """A frame of any bus, with its own time."""
        self._waiting += packed(message)
        self.flush()

    def flush(self, *, at_once: bool = False) -> None:
        """Write what waits, when a block is full or the time has come."""
        now_s = time.monotonic()
        due = at_once or now_s - self._flushed_s >= FLUSH_EVERY_S
        while self._waiting and (due or len(self._waiting) >= _BLOCK_BYTES):
            block, self._waiting = bytes(self._waiting[:_BLOCK_BYTES]), self._waiting[_BLOCK_BYTES:]
            self._blocks.append(FRAMES, block)
        if due:
            self._flushed_s = now_s

    def close(self, ended: str = "", counts: Mapping[str, object] | None = None) -> None:
        """Write the end and close the file. ended: why; counts: what the recorder counted."""
        with self._blocks:
            self.flush(at_once=True)
            self._write_truth()
            self._append_json(DONE, {"ended": ended, **(counts or {})})

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

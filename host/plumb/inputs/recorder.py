"""Record a running board to files while its frames arrive.

    frames.asc   all frames with their receive times, for python-can and other tools that read such logs
    steps.csv    one row per step: raw counts and the selected signals, in the units of the DBC
    board.json   identity of board and host, and every parameter of the run

A signal that was not received is an empty cell. If the recorder is killed, at most the last second is lost (of a .blf
log, which is compressed in blocks, the last block).
"""

from __future__ import annotations

import contextlib
import csv
import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import can

from plumb import __version__
from plumb.errors import UsageError
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.protocol import Frame
from plumb.spec.signals import signals

FLUSH_EVERY_S = 1.0
SUFFIXES = (".asc", ".blf", ".csv", ".log", ".trc")
RAW_COLUMNS = tuple(f"raw_{index}_counts" for index in range(6))
NOTHING: tuple[str, ...] = ("",) * 6


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert an OSError while writing `path` to a UsageError of one sentence."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}; what was written before is kept") from None


def check_kept(path: Path) -> None:
    """Raises UsageError if the file was deleted while it is written."""
    if not path.exists():
        raise UsageError(f"{path} was deleted while it was written: nothing is kept, record again")


class FrameLog:
    """A log of frames in the format of its suffix, flushed to the disk every second. Raises UsageError if it cannot be
    written."""

    def __init__(self, path: Path) -> None:
        if path.suffix not in SUFFIXES:
            raise UsageError(f"{path}: a log of frames ends in {', '.join(SUFFIXES)}")
        self._path = path
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._log: Any = can.Logger(path)  # Any: python-can gives one of its writers, without a common type
        self._flushed_s = time.monotonic()

    def add(self, message: can.Message) -> None:
        with writing(self._path):
            self._log(message)
        self.flush()

    def flush(self) -> None:
        """Flush to the disk if a second has passed since the last time."""
        if time.monotonic() - self._flushed_s > FLUSH_EVERY_S:
            with writing(self._path):
                self._log.file.flush()
            check_kept(self._path)
            self._flushed_s = time.monotonic()

    def close(self) -> None:
        with writing(self._path):
            self._log.stop()
        check_kept(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def message_of(frame: Frame, time_s: float) -> can.Message:
    """A frame as a python-can message. time_s: its time stamp."""
    identifier, data = frame
    return can.Message(
        timestamp=time_s, arbitration_id=identifier, is_extended_id=False, dlc=len(data), data=data, channel=0
    )


class Recorder:
    """Writes frames and steps; call `feed` with all received frames.

    rows: steps written; lost: those of them without counts or digest; words: the board's parameters. identity: written
    to board.json under that name; None: left out.
    """

    def __init__(self, session: Session, folder: Path, identity: Mapping[str, object] | None = None) -> None:
        self.rows = self.lost = 0
        self._capture = Capture(session, raw_frames=())
        self._next: int | None = None
        # Log formats need a date; the clock of a simulated board counts seconds from its start.
        self._clock = time.time if session.clock is time.monotonic else session.clock
        self._flushed_s = time.monotonic()
        self._signals = signals(session.system)
        about: dict[str, object] = {"plumb": __version__, "board": (session.identity or session.connect()).items}
        self.words = session.read_parameters()
        about["parameters"] = dict(zip((row.name for row in parameters.table()), self.words, strict=False))
        if identity is not None:
            about["identity"] = dict(identity)
        self._path = folder / "steps.csv"
        with writing(folder / "board.json"):
            (folder / "board.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
        with contextlib.ExitStack() as opened:
            self._log = opened.enter_context(FrameLog(folder / "frames.asc"))
            with writing(self._path):
                self._file = opened.enter_context(self._path.open("w", newline="", encoding="utf-8"))
                self._csv = csv.writer(self._file)
                self._csv.writerow(["step", "digest", *RAW_COLUMNS, *(column for _, column, _ in self._signals)])
            self._opened = opened.pop_all()

    def feed(self, frames: list[Frame]) -> None:
        now_s = self._clock()
        for frame in frames:
            self._log.add(message_of(frame, now_s))
        self._capture.feed(frames)
        with writing(self._path):
            self._write(self._capture.steps - 1)  # the newest step may not be complete yet
            if time.monotonic() - self._flushed_s > FLUSH_EVERY_S:
                self._file.flush()
                self._flushed_s = time.monotonic()

    def _write(self, end: int) -> None:
        capture = self._capture
        if self._next is None and end > 0:
            self._next = min([*capture.digest, *capture.raw])
        while self._next is not None and self._next < end:
            step, self._next = self._next, self._next + 1
            digest, raw = capture.digest.pop(step, None), capture.raw.pop(step, None)
            self.lost += digest is None
            cells: list[object] = [step, "" if digest is None else f"{digest:08x}"]
            cells += raw if raw is not None else NOTHING
            for signal, _, scale in self._signals:
                value = capture.values.get(signal, {}).pop(step, None)
                cells.append("" if value is None else f"{value * scale:.9g}")
            self._csv.writerow(cells)
            self.rows += 1

    def close(self) -> None:
        with self._opened, writing(self._path):
            self._write(self._capture.steps)
            self._file.close()
        check_kept(self._path)

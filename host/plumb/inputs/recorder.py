"""A running board into files: every frame as it came, and a row for every step, written as they come.

    frames.asc   all frames with the times they were heard at, for python-can and the tools that read such logs
    steps.csv    a row a step: raw counts and the selected signals, in the units of the message definitions
    board.json   what the board and the host were, and every parameter of the run

What a step did not say is an empty cell. Killing the recorder loses at most a second (of a .blf log, which is
compressed by the block, its last block).
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
    """What goes wrong with a file, as one sentence: UsageError."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}; what was written before is kept") from None


def check_kept(path: Path) -> None:
    """Raises UsageError when the file that is being written has been deleted: what goes into it is lost."""
    if not path.exists():
        raise UsageError(f"{path} was deleted while it was written: nothing is kept, record again")


class FrameLog:
    """A log of frames in the format of its suffix, on the disk to the last second. Raises UsageError when it cannot be
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
        """When it is due."""
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
    """For a log."""
    identifier, data = frame
    return can.Message(
        timestamp=time_s, arbitration_id=identifier, is_extended_id=False, dlc=len(data), data=data, channel=0
    )


class Recorder:
    """Feed it the frames as they come. rows: steps written; lost: steps among them without counts or digest; words: the
    board's parameters. identity: an entry of that name of board.json, None: none."""

    def __init__(self, session: Session, folder: Path, identity: Mapping[str, object] | None = None) -> None:
        self.rows = self.lost = 0
        self._capture = Capture(session, raw_frames=())
        self._next: int | None = None
        # Log formats want a date; a simulated board has seconds since its start.
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
            self._write(self._capture.steps - 1)  # the last one heard of may not be complete
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

"""Record a running board to a log (.plog), or the frames of a bus to a log or to a file of another tool's format."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import can

from plumb.errors import UsageError
from plumb.files.block_file import exists_sentence
from plumb.link.session import Session
from plumb.link.transports.waiting_board import is_wall_clock
from plumb.link.used_tables import ALL_PARAMETERS, UsedTables
from plumb.spec.protocol import Frame, protocol
from plumb.writers.log_writer import LogWriter

FLUSH_EVERY_S = 1.0
SUFFIXES = (".asc", ".blf", ".csv", ".log", ".trc")
"""Formats of other tools that a bus is recorded to as its frames arrive."""


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
    """A log of frames in the format of its suffix, flushed to the disk every second. Raises UsageError if it exists,
    unless `replace`, or cannot be written."""

    def __init__(self, path: Path, *, replace: bool = False) -> None:
        if path.suffix not in SUFFIXES:
            raise UsageError(f"{path}: a log of frames ends in {', '.join(SUFFIXES)}")
        if path.exists() and not replace:
            raise UsageError(exists_sentence(path))
        self._path = path
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._log: Any = can.Logger(path)  # Any: python-can gives one of its writers, without a common type
        self._flushed_s = time.monotonic()

    def add_message(self, message: can.Message) -> None:
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


Batch = tuple[float, list[Frame]]
"""Frames that were received together, and when, by the session's clock."""


class RunMemory:
    """The frames of the run in progress from its RUN_BEGIN on, so that a recording that begins later holds the whole
    run and can be reproduced. Of a run of more than FRAMES_MAX frames nothing is kept.

    partial: a run is on whose beginning is not kept.
    """

    FRAMES_MAX = 1 << 20
    """Four minutes of a full UART, more of slower runs; about 130 MB of memory."""

    def __init__(self) -> None:
        self._ack, self._begin = protocol()["ACK"], protocol()["RUN_BEGIN"].identifier
        self._batches: list[Batch] = []
        self._frames, self._whole, self.partial = 0, False, False
        self._step = protocol()["STEP"].identifier

    def feed(self, frames: list[Frame], time_s: float) -> None:
        for place, (identifier, data) in enumerate(frames):
            if identifier == self._ack.identifier and self._ack.decode(data)["request"] == self._begin:
                self._batches, self._frames, self._whole, self.partial = [], 0, True, False
                frames = frames[place:]
                break
        if self._whole and frames:
            self._batches.append((time_s, frames))
            self._frames += len(frames)
            if self._frames > self.FRAMES_MAX:
                self._batches, self._whole = [], False
        elif not self._whole:
            self.partial |= any(identifier == self._step for identifier, _ in frames)

    @property
    def batches(self) -> list[Batch]:
        """The frames of the run; [] when its beginning is not known any more."""
        return list(self._batches)


class Recorder:
    """Writes what a session receives to a log; call `feed` with all received frames, from the beginning on: the
    parameters are read here, and again when another link has changed them during a run, so that the log holds them.

    frames, steps: numbers received; lost: steps that are missing between them. head: entries of the log's first block.
    before: batches of frames of the run in progress with their times, as a `RunMemory` has them: they come first.
    begun_with: the table with which that run began; None: the one that is in use now. read: False for a caller that
    gives begun_with, and asks the board for nothing here.
    """

    def __init__(
        self,
        session: Session,
        path: Path,
        head: Mapping[str, object],
        *,
        replace: bool = False,
        before: Iterable[Batch] = (),
        begun_with: Sequence[int] | None = None,
        read: bool = True,
    ) -> None:
        simulated = not is_wall_clock(session.clock)
        self._clock = session.clock
        self._epoch_s = 0.0 if simulated else time.time() - time.monotonic()  # so that no time runs back
        board = (session.identity or session.connect()).items
        self.frames = self.steps = self.lost = 0
        self._step, self._last = session.protocol["STEP"], -1
        self._session = session
        self.log = LogWriter(path, {**head, "board": board}, simulated=simulated, replace=replace)
        listener, answers = session.listener, list[Batch]()

        def both(frames: list[Frame]) -> None:
            """The answers are recorded, too, so that an export to BLF carries the parameters."""
            answers.append((self._clock(), frames))
            if listener is not None:
                listener(frames)

        session.listener = both
        try:
            now = session.read_parameters() if read or begun_with is None else begun_with
            words = now if begun_with is None else begun_with
            self._tables = UsedTables(session.protocol, words)
            self._of_tables = self._tables.identifiers
            self.log.parameters(words)
            for time_s, frames in [*before, *answers]:
                self.add(frames, time_s)
        except BaseException:
            self.log.close("the parameters were not read")
            raise
        finally:
            session.listener = listener

    def feed(self, frames: list[Frame]) -> None:
        self.add(frames, self._clock())
        if self._tables.ask(self._clock()):
            self._session.send([self._session.frame("PARAM_GET", ALL_PARAMETERS, 0)])

    def add(self, frames: list[Frame], time_s: float) -> None:
        """Write frames that came at a time of the session's clock, and ask the board for nothing."""
        self.frames += len(frames)
        for identifier, data in frames:
            if identifier == self._step.identifier:
                self._count(self._step.unpack(data)[2])
            elif identifier in self._of_tables:
                self._tables.feed(identifier, data, self._last + 1)
        self.log.add(frames, self._epoch_s + time_s)

    def truth(self, values: Mapping[str, float], time_s: float) -> None:
        """The true place of a simulated vehicle at a time of the session's clock."""
        self.log.truth(values, self._epoch_s + time_s)

    def _count(self, low: int) -> None:
        """low: low 16 bits of a step's number; one that goes back begins a new run."""
        gap = (low - self._last - 1) & 0xFFFF
        self.lost += gap if self._last >= 0 and gap < 0x8000 else 0
        self.steps, self._last = self.steps + 1, low

    def close(self, ended: str = "") -> None:
        """Write the end of the log. ended: why the recording ended."""
        self.log.close(ended, {"frames": self.frames})

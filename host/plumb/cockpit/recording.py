"""Recordings that a page starts and stops: a log each, as `plumb record` writes it, and its report.

A log is written by a thread of its own: the beginning of a long run takes seconds to write, in which an armed board
would wait for a keep-alive. The loop only queues the frames, and no page, however slow, takes a sample from them.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.errors import PlumbError, UsageError, counted
from plumb.link.used_tables import ALL_PARAMETERS
from plumb.proof import run_identity
from plumb.readers import log_replay
from plumb.spec.protocol import Frame
from plumb.writers import log_export
from plumb.writers.record_report import Compared
from plumb.writers.recorder import Batch, Recorder, RunMemory

TRUTH_EVERY_S = 0.05


@dataclass(frozen=True)
class Truth:
    """The true place of a simulated vehicle, in m by name, at a time of the session's clock."""

    time_s: float
    values: Mapping[str, float]


Item = Batch | Sequence[int] | Truth | None
"""Frames and their time; or the table with which a run begins; or the truth at a time; or the end."""


class Recording:
    """At most one recording at a time, into a new log in `folder`. say: called, by any thread, with a text for the
    pages.
    reports: those that are written."""

    def __init__(self, folder: Path, command: str, say: Callable[[str], None]) -> None:
        self._folder, self._command, self._say = folder, command, say
        self.reports: list[Path] = []
        self._head: Mapping[str, object] = {}
        self._memory = RunMemory()
        self._words: Sequence[int] = ()
        self._truth_s = float("-inf")
        self._writer: LogThread | None = None
        self._ended: list[LogThread] = []

    @property
    def state(self) -> dict[str, object]:
        writer = self._writer
        if writer is None or writer.failed:
            return {"on": False}
        recorder = writer.recorder
        return {"on": True, "steps": recorder.steps, "lost": recorder.lost, "log": str(writer.path)}

    def of(self, board: LinkBoard) -> None:
        """Note which board the frames are of from here on."""
        self._head = run_identity.identity(run_identity.part_of(board), None, self._command)

    def start(self, board: LinkBoard, words: Sequence[int]) -> None:
        """Record, with the run in progress from its beginning where that is known. words: the table in use. Raises
        UsageError when one is on, or when the log cannot be written."""
        if self.state["on"]:
            raise UsageError("a recording is on: stop it first")
        self.stop()
        stem = time.strftime("%Y-%m-%d_%H-%M-%S")
        path = next(path for path in _names(self._folder, stem) if not path.exists())
        before = self._memory.batches
        begun_with = self._words if before else words
        recorder = Recorder(board.session, path, self._head, begun_with=begun_with, read=False)
        self._writer = LogThread(recorder, path, self._say, self.reports)
        for batch in before:
            self._writer.items.put(batch)
        missing = "; the beginning of this run is not in it, so that it cannot be replayed"
        self._say(f"recording into {path}{missing if self._memory.partial else ''}")
        # The answers are recorded like all frames, so that an export to other formats has the parameters.
        board.session.send([board.session.frame("PARAM_GET", ALL_PARAMETERS, 0)])

    def parameters(self, words: Sequence[int]) -> None:
        """The whole table in use from here on: a new run begins."""
        self._words = words
        if self._writer is not None:
            self._writer.items.put(list(words))

    def feed(self, frames: list[Frame], time_s: float) -> None:
        """Queue the frames for the log, and remember those of the run. time_s: by the session's clock."""
        self._memory.feed(frames, time_s)
        if self._writer is not None and self._writer.failed:
            self.stop()
        if self._writer is not None and frames:
            self._writer.items.put((time_s, frames))

    def truth(self, values: Mapping[str, float], time_s: float) -> None:
        """Queue the true place of a simulated vehicle, every TRUTH_EVERY_S, while a recording is on."""
        if self._writer is not None and not 0.0 <= time_s - self._truth_s < TRUTH_EVERY_S:
            self._truth_s = time_s
            self._writer.items.put(Truth(time_s, values))

    def run_ended(self, compared: Compared | None) -> None:
        """Note what the shadow says of a run of which the recording, if one is on, has steps."""
        if self._writer is not None:
            self._writer.compared.append(compared)

    def stop(self) -> None:
        """End the recording, if one is on."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.items.put(None)
            self._ended = [one for one in self._ended if one.is_alive()] + [writer]

    def wait(self) -> None:
        """Until the recordings that were stopped, and their reports, are written."""
        for writer in self._ended:
            writer.join()


class LogThread(threading.Thread):
    """Writes what is queued to the log, until the end or until the log cannot be written: a full disk ends the
    recording, not the run. items: what is to be written; failed: whether it ended by itself; reports: gets the report
    when it is there; compared: what the shadow said of each run, for the report."""

    def __init__(self, recorder: Recorder, path: Path, say: Callable[[str], None], reports: list[Path]) -> None:
        super().__init__(name="log")
        self.recorder, self.path, self._say, self._reports = recorder, path, say, reports
        self.items: queue.SimpleQueue[Item] = queue.SimpleQueue()
        self.failed = False
        self.compared: list[Compared | None] = []
        self.start()

    def run(self) -> None:
        try:
            while (item := self.items.get()) is not None:
                self._write(item)
            self.recorder.close("stopped")
        except UsageError as error:
            self.failed = True
            self._say(f"the recording ended: {error}")
            return
        lost = f", {self.recorder.lost} more were lost" if self.recorder.lost else ""
        self._say(f"recorded {counted(self.recorder.steps, 'step')}{lost} into {self.path}")
        self._report()

    def _write(self, item: Batch | Sequence[int] | Truth) -> None:
        if isinstance(item, Truth):
            self.recorder.truth(item.values, item.time_s)
        elif isinstance(item, tuple):
            time_s, frames = item
            self.recorder.add(frames, time_s)
        else:
            self.recorder.log.parameters(item)

    def _report(self) -> None:
        page = self.path.with_suffix(".html")
        try:
            log = log_replay.open_log(self.path)
            run = log_replay.chosen(log_replay.runs_of(log), None)
            compared = self.compared[run.number - 1] if len(self.compared) == run.of else None
            log_export.export(log, run, page, compared=compared)
        except PlumbError as error:
            self._say(f"no report was written: {error}")
        else:
            self._reports.append(page)
            self._say(f"report: {page}")


def _names(folder: Path, stem: str) -> list[Path]:
    """Names for a new log, the best first."""
    return [folder / f"{stem}{more}.plog" for more in ("", *(f"_{index}" for index in range(2, 100)))]

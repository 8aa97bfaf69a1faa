"""Recordings that a page starts and stops: a log each, as `plumb record` writes it, and its report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.errors import PlumbError, UsageError
from plumb.inputs import log_export, log_replay
from plumb.inputs.recorder import Recorder, RunMemory
from plumb.proof import run_identity
from plumb.spec.protocol import Frame


class Recording:
    """At most one recording at a time, into a new log in `folder`. It is written by the board's thread, from the frames
    themselves: no page, however slow, takes a sample from it. say: called with what the user should know."""

    def __init__(self, folder: Path, command: str, say: Callable[[str], None]) -> None:
        self._folder, self._command, self._say = folder, command, say
        self._recorder: Recorder | None = None
        self._path = folder
        self._memory = RunMemory()
        self._words: Sequence[int] | None = None

    @property
    def state(self) -> dict[str, object]:
        recorder = self._recorder
        if recorder is None:
            return {"on": False}
        return {"on": True, "steps": recorder.steps, "lost": recorder.lost, "log": str(self._path)}

    def start(self, board: LinkBoard) -> None:
        """Raises UsageError when one is on, or when the log cannot be written."""
        if self._recorder is not None:
            raise UsageError("a recording is on: stop it first")
        stem = time.strftime("%Y-%m-%d_%H-%M-%S")
        self._path = next(path for path in _names(self._folder, stem) if not path.exists())
        head = run_identity.identity(run_identity.part_of(board), None, self._command)
        before = self._memory.batches
        begun_with = self._words if before else None
        self._recorder = Recorder(board.session, self._path, head, before=before, begun_with=begun_with)
        missing = "; the beginning of this run is not in it, so that it cannot be replayed"
        self._say(f"recording into {self._path}{missing if self._memory.partial else ''}")

    def parameters(self, words: Sequence[int]) -> None:
        """The whole table in use from here on: a new run begins."""
        self._words = words
        if self._recorder is not None:
            self._recorder.log.parameters(words)

    def feed(self, frames: list[Frame], time_s: float) -> None:
        """Write the frames, and remember those of the run. time_s: by the session's clock. A full disk ends the
        recording, not the run."""
        self._memory.feed(frames, time_s)
        if self._recorder is not None and frames:
            try:
                self._recorder.feed(frames)
            except UsageError as error:
                self._say(f"the recording ended: {error}")
                self._recorder = None

    def stop(self) -> None:
        """End the recording, if one is on, and write its report in a thread of its own: that takes a while."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close("stopped")
        except UsageError as error:
            self._say(f"the recording ended: {error}")
            return
        lost = f", {recorder.lost} more were lost" if recorder.lost else ""
        self._say(f"recorded {recorder.steps} steps{lost} into {self._path}")
        threading.Thread(target=self._report, args=(self._path,), name="report").start()

    def _report(self, path: Path) -> None:
        try:
            log = log_replay.open_log(path)
            page = path.with_suffix(".html")
            log_export.export(log, log_replay.chosen(log_replay.runs_of(log), None), page)
        except PlumbError as error:
            self._say(f"no report was written: {error}")
        else:
            self._say(f"report: {page}")


def _names(folder: Path, stem: str) -> list[Path]:
    """Names for a new log, the best first."""
    return [folder / f"{stem}{more}.plog" for more in ("", *(f"_{index}" for index in range(2, 100)))]

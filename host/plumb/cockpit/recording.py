"""Recordings that a page starts and stops: the files of `plumb record`, in a folder of their own each time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.errors import PlumbError, UsageError
from plumb.inputs import record_report
from plumb.inputs.recorder import Recorder
from plumb.link.session import Session
from plumb.spec.protocol import Frame


class Recording:
    """At most one recording at a time, into a new folder below `folder`. It is written by the board's thread, from the
    frames themselves: no page, however slow, takes a sample from it. say: called with what the user should know."""

    def __init__(self, board: LinkBoard, folder: Path, command: str, say: Callable[[str], None]) -> None:
        self._board, self._folder, self._command, self._say = board, folder, command, say
        self._recorder: Recorder | None = None
        self._path = folder

    @property
    def state(self) -> dict[str, object]:
        recorder = self._recorder
        if recorder is None:
            return {"on": False}
        return {"on": True, "steps": recorder.rows, "lost": recorder.lost, "folder": str(self._path)}

    def start(self, session: Session) -> None:
        """Raises UsageError when one is on, or when its folder cannot be written."""
        if self._recorder is not None:
            raise UsageError("a recording is on: stop it first")
        stem = time.strftime("%Y-%m-%d_%H-%M-%S")
        self._path = next(path for path in _names(self._folder, stem) if not path.exists())
        try:
            self._path.mkdir(parents=True)
        except OSError as error:
            raise UsageError(f"the folder {self._path} cannot be created: {error.strerror}") from None
        self._recorder = Recorder(session, self._path, record_report.identity_of(self._board, self._command))
        self._say(f"recording into {self._path}")

    def feed(self, frames: list[Frame]) -> None:
        """Write the frames. A full disk ends the recording, not the run."""
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
            recorder.close()
        except UsageError as error:
            self._say(f"the recording ended: {error}")
            return
        lost = f", {recorder.lost} of them lost" if recorder.lost else ""
        self._say(f"recorded {recorder.rows} steps{lost} into {self._path}")
        threading.Thread(target=self._report, args=(self._path, recorder), name="report").start()

    def _report(self, path: Path, recorder: Recorder) -> None:
        try:
            page = record_report.write_report(path, self._board, recorder.words, recorder.lost, {}, self._command)
        except PlumbError as error:
            self._say(f"no report was written: {error}")
        else:
            if page is not None:
                self._say(f"report: {page}")


def _names(folder: Path, stem: str) -> list[Path]:
    """Names for a new folder, the best first."""
    return [folder / stem, *(folder / f"{stem}_{index}" for index in range(2, 100))]

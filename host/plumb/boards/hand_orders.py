"""Orders for the hand that holds a simulated body, as lines of a file, a named pipe or stdin.

A line names a pose by its name, its number or an unambiguous beginning; then, optionally, the share of the way and the
time that the turn takes: `left side up`, `3`, `left 50% 2s`. A file is read as it grows; lines that it already had at
the start are ignored.
"""

from __future__ import annotations

import os
import re
import stat
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Protocol

from plumb.errors import UsageError
from plumb.physics.hand import TURN_S, Hand

STDIN = "-"
EVERY_S = 0.02
"""Interval at which a file is read."""
MOST_BYTES = 1 << 16
COMPARED_BYTES = 256
LONGEST_S, MOST_SHARE = 60.0, 4.0
"""Limits of an order: a turn that takes a minute, and four times the way to the pose."""
SHOWN = 60
"""Characters of a line that a message quotes."""
_SHARE = re.compile(r"([+-]?\d{1,4}(?:\.\d{1,3})?)%")
_SECONDS = re.compile(r"(\d{1,4}(?:\.\d{1,3})?) ?s")


@dataclass(frozen=True)
class Order:
    """A pose, the time that the turn takes, and the share of the way; 0.5 stops half-way."""

    pose: str
    over_s: float = TURN_S
    share: float = 1.0


def parse(line: str, poses: Sequence[str]) -> Order | None:
    """The order of a line; None for an empty line or a comment. Raises UsageError that names the poses."""
    text = " ".join(line.partition("#")[0].lower().split())
    if not text:
        return None
    share, text = _number(_SHARE, text, 100.0)
    over_s, text = _number(_SECONDS, text, TURN_S)
    if not 0.0 < over_s <= LONGEST_S or abs(share) > 100.0 * MOST_SHARE:
        raise UsageError(f"a turn takes up to {LONGEST_S:.0f} s, and goes up to {100 * MOST_SHARE:.0f} % of the way")
    return Order(_pose(text, poses), over_s, share / 100.0)


def _number(form: re.Pattern[str], text: str, default: float) -> tuple[float, str]:
    """The number of the word of this form, and the text without it."""
    found = re.search(rf"(?:^| ){form.pattern}(?: |$)", text)
    if found is None:
        return default, text
    return float(found[1]), " ".join((text[: found.start()] + " " + text[found.end() :]).split())


def _pose(text: str, poses: Sequence[str]) -> str:
    if text.isdecimal() and 1 <= int(text[:4]) <= len(poses):
        return poses[int(text[:4]) - 1]
    able = [pose for pose in poses if pose == text] or [pose for pose in poses if text and pose.startswith(text)]
    if len(able) != 1:
        named = ", ".join(f"{number} {pose}" for number, pose in enumerate(poses, 1))
        raise UsageError(f"'{text:.{SHOWN}}' is none of the poses: {named}")
    return able[0]


class Lines(Protocol):
    """A source of text. read(): the bytes that came since the last call, b"" for none."""

    def read(self) -> bytes: ...


class GrowingFile:
    """Text that is appended to a file; a file that was rewritten is read from its start. A missing file is created."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()
        self._stamp = 0, 0
        self._end = path.stat().st_size
        with path.open("rb") as file:
            file.seek(max(self._end - COMPARED_BYTES, 0))
            self._tail = file.read(COMPARED_BYTES)
        self._end = max(self._end - COMPARED_BYTES, 0) + len(self._tail)
        """Position up to which the file was read; `_tail` holds the bytes before it, which differ in a rewritten
        file."""

    def read(self) -> bytes:
        try:
            state = self._path.stat()
            if (stamp := (state.st_mtime_ns, state.st_size)) == self._stamp or not stat.S_ISREG(state.st_mode):
                return b""
            with self._path.open("rb") as file:
                file.seek(self._end - len(self._tail))
                grown = file.read(len(self._tail)) == self._tail
                file.seek(self._end if grown else 0)
                text = file.read(MOST_BYTES)
                self._end = file.tell()
        except OSError:  # an editor is replacing the file, or it cannot be read for now
            return b""
        self._stamp = stamp
        self._tail = ((self._tail if grown else b"") + text)[-COMPARED_BYTES:]
        return text


class NamedPipe:
    """Text that programs write to a named pipe."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))

    def read(self) -> bytes:
        try:
            return os.read(self._descriptor, MOST_BYTES)
        except BlockingIOError:  # a writer has opened the pipe and not written yet
            return b""


class StandardInput:
    """Text that is typed. A thread reads the descriptor, because only a blocking read waits for a terminal on every
    platform."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[bytes] = SimpleQueue()
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            try:
                data = os.read(0, MOST_BYTES)
            except OSError:
                return
            if not data:
                return
            self._queue.put(data)

    def read(self) -> bytes:
        try:
            return self._queue.get_nowait()
        except Empty:
            return b""


def lines_of(name: str) -> Lines:
    """The source that --hand names. Raises UsageError for a file that cannot be read."""
    if name == STDIN:
        return StandardInput()
    path = Path(name)
    try:
        if path.exists() and stat.S_ISFIFO(path.stat().st_mode):
            return NamedPipe(path)
        if not path.exists() or path.is_file():
            return GrowingFile(path)
        reason = "no file and no named pipe"
    except OSError as error:
        reason = str(error.strerror)
    raise UsageError(f"{name}: {reason}: name a file that can be read and written, or -")


class HandOrders:
    """Carries out the orders of a source. say: called with the hand's action, or with the reason for refusing an
    order."""

    def __init__(self, hand: Hand, lines: Lines, say: Callable[[str], None]) -> None:
        self._hand, self._lines, self._say = hand, lines, say
        self._rest, self._next_s = b"", 0.0

    def look(self) -> None:
        """Carry out the orders that have arrived; call it often."""
        if (now_s := time.monotonic()) < self._next_s:
            return
        self._next_s = now_s + EVERY_S
        *whole, self._rest = (self._rest + self._lines.read()).split(b"\n")
        self._rest = self._rest[-MOST_BYTES:]
        for line in whole:
            self._carry_out(line.decode("utf-8", "replace"))

    def _carry_out(self, line: str) -> None:
        try:
            order = parse(line, self._hand.poses)
        except UsageError as error:
            self._say(f"hand: {error}")
            return
        if order is not None:
            self._hand.put(order.pose, order.over_s, order.share)
            part = "" if order.share == 1.0 else f", {100 * order.share:g} % of the way"
            self._say(f"hand: {order.pose}{part}, within {order.over_s:g} s")


def send_order(name: str, pose: str) -> None:
    """Write an order for the hand of a served board, which reads this file or pipe. Raises UsageError."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NONBLOCK", 0)
    try:
        descriptor = os.open(name, flags, 0o666)
    except OSError as error:
        reason = "no board reads it" if stat.S_ISFIFO(_mode(name)) else error.strerror
        raise UsageError(f"{name}: {reason}: start `plumb virtual-board --system SYSTEM --hand {name}` first") from None
    try:
        os.write(descriptor, f"{pose}\n".encode())
    except BlockingIOError:
        raise UsageError(f"{name}: the board that reads it has stopped: start it anew") from None
    except OSError as error:
        raise UsageError(f"{name}: {error.strerror}: name a file that can be written") from None
    finally:
        os.close(descriptor)


def _mode(name: str) -> int:
    try:
        return Path(name).stat().st_mode
    except OSError:
        return 0

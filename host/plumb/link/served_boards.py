"""Which boards other processes serve on this machine: each has an entry in the platform's folder for running programs.

The serving process holds a lock file next to its entry. The operating system drops that lock when the process ends,
however it ends, so that an entry without a lock is stale; the next look removes it.
"""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from plumb.errors import PlumbError
from plumb.files import places
from plumb.files.input_files import read_bytes

MOST_BYTES = 1 << 16


@dataclass(frozen=True)
class ServedBoard:
    """A board that a process serves. names: the board as --board takes it, the preferred name first."""

    names: tuple[str, ...]
    system: str
    process: int


def folder() -> Path:
    return places.runtime_folder() / "boards"


class Entry:
    """The entry of a board that this process serves. Without a folder to write to there is none, and the board is
    served all the same."""

    def __init__(self, system: str) -> None:
        self._board = ServedBoard((), system, os.getpid())
        self._path = folder() / f"{os.getpid()}.json"
        self._lock: FileLock | None = None

    def __enter__(self) -> Entry:
        with contextlib.suppress(OSError, Timeout, NotImplementedError):
            folder().mkdir(parents=True, exist_ok=True, mode=0o700)
            if not _ours():
                return self
            lock = FileLock(self._path.with_suffix(".lock"))
            lock.acquire(timeout=0)
            self._lock = lock
        return self

    def add(self, name: str) -> None:
        """Publish another name of the board; its serial link goes before CAN."""
        names = sorted((*self._board.names, name), key=lambda one: not one.startswith("serial:"))
        self._board = ServedBoard(tuple(names), self._board.system, self._board.process)
        if self._lock is not None:
            part = self._path.with_suffix(".part")
            with contextlib.suppress(OSError):
                part.write_text(json.dumps(asdict(self._board)), encoding="utf-8")
                part.replace(self._path)

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
            _remove(self._path)
            self._lock.release()


def served_boards() -> list[ServedBoard]:
    """The boards that are served at present; removes the entries of processes that have ended."""
    found = []
    for path in sorted(folder().glob("*.json")) if _ours() else []:
        lock = FileLock(path.with_suffix(".lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            board = _read(path)
            if board is not None:
                found.append(board)
            continue
        except (OSError, NotImplementedError):
            continue
        _remove(path)
        lock.release()
    return found


def _ours() -> bool:
    """Whether the folder is this user's: where the system has no such folder, it lies among the temporary files, and
    somebody else could have made it to lead a host to another board."""
    try:
        return not hasattr(os, "getuid") or folder().stat().st_uid == os.getuid()
    except OSError:
        return False


def _remove(path: Path) -> None:
    for one in (path, path.with_suffix(".lock")):
        with contextlib.suppress(OSError):
            one.unlink()


def _read(path: Path) -> ServedBoard | None:
    """The entry; None for one that is not readable, or not of another plumb."""
    try:
        said = json.loads(read_bytes(path, MOST_BYTES, "").decode())
        names, system, process = said["names"], said["system"], said["process"]
    except (OSError, PlumbError, ValueError, RecursionError, KeyError, TypeError):
        return None
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        return None
    return ServedBoard(tuple(names), str(system), process) if isinstance(process, int) else None

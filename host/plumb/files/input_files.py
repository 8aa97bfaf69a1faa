"""Read a file that a user names: a regular file of at most a stated size. Anything else is one sentence.

A device, a pipe or a folder is refused before it is opened, so that an endless one cannot hang the command.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from plumb.errors import UsageError

MIB = 1 << 20


def check(path: Path, most_bytes: int, advice: str) -> None:
    """Raises UsageError, with the advice, unless the path is a regular file of at most `most_bytes` bytes."""
    _limit(path, check_regular(path, advice), most_bytes, advice)


def check_regular(path: Path, advice: str) -> int:
    """The size of a regular file; raises UsageError, with the advice, for anything else."""
    try:
        status = path.stat()
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}; {advice}") from None
    if not stat.S_ISREG(status.st_mode):
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
        raise UsageError(f"cannot read {path}: it is {what}, no file; {advice}")
    return status.st_size


def read_bytes(path: Path, most_bytes: int, advice: str) -> bytes:
    """The file's content; raises UsageError as `check`. A file that grows meanwhile is not read beyond the limit."""
    check(path, most_bytes, advice)
    try:
        with path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or os.strerror(error.errno or 0)}; {advice}") from None
    _limit(path, len(data), most_bytes, advice)
    return data


def read_text(path: Path, most_bytes: int, advice: str) -> str:
    """The file's content as UTF-8; raises UsageError as `check`."""
    try:
        return read_bytes(path, most_bytes, advice).decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path} is no text ({error.reason} at byte {error.start}); {advice}") from None


def _limit(path: Path, size: int, most_bytes: int, advice: str) -> None:
    if size > most_bytes:
        most = f"{most_bytes // MIB} MiB" if most_bytes >= MIB else f"{most_bytes} bytes"
        raise UsageError(f"cannot read {path}: it has more than {most}; {advice}")

"""Write a set of files completely, or leave the old files unchanged."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from plumb.errors import UsageError


def write_whole(contents: Mapping[Path, str | bytes], advice: str) -> None:
    """Write each file to PATH.part, then rename all of them; create missing folders.

    Raises UsageError, with the advice, when a file cannot be written. The .part files are removed in any case.
    """
    parts = {path: path.with_name(path.name + ".part") for path in contents}
    path = Path()
    try:
        for path, part in parts.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, "it is a folder")
            content = contents[path]
            data = content if isinstance(content, bytes) else content.encode("utf-8", "backslashreplace")
            part.write_bytes(data)
        for path, part in parts.items():
            part.replace(path)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}; {advice}") from None
    finally:
        with contextlib.suppress(OSError):
            for part in parts.values():
                part.unlink(missing_ok=True)


def require_different(paths: Iterable[Path], advice: str) -> None:
    """Raises UsageError, with the advice, for two that are the same file, however they are written."""
    seen: set[str] = set()
    for path in paths:
        real = os.path.realpath(path)  # which takes links that lead in a circle, too
        if real in seen:
            raise UsageError(f"{path} is named twice; {advice}")
        seen.add(real)


def require_writable(path: Path, advice: str) -> None:
    """Raises UsageError, with the advice, unless `write_whole` can write the file. Leaves nothing behind."""
    part = path.with_name(path.name + ".part")
    missing = [folder for folder in path.parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        part.touch()
        part.unlink()
        for folder in missing:
            folder.rmdir()
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}; {advice}") from None

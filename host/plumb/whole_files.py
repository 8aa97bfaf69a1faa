"""Write files whole, or leave what was there."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Mapping
from pathlib import Path

from plumb.errors import UsageError


def write_whole(contents: Mapping[Path, str | bytes], advice: str) -> None:
    """All files are written beside their places before the first one moves in; a folder that is missing is made.

    Raises UsageError, with the advice, when one cannot be written; what was there is left then, and nothing beside it.
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

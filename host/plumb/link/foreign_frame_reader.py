"""Decode a file of frames of another tool. Runs in the process that `plumb.files.bounded_reader` starts."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

BLOCK_FRAMES = 4096


def pieces(path: Path) -> Iterator[bytes]:
    """The records of a file's frames. Raises what the libraries raise."""
    if path.suffix.lower() != ".mf4":
        sys.modules["asammdf"] = None  # type: ignore[assignment]  # python-can loads it, and it pandas: seconds
    import can

    from plumb.link.frame_records import packed

    waiting: list[bytes] = []
    with can.LogReader(path) as reader:
        for message in reader:
            if not message.is_fd and len(message.data or b"") <= 8:
                waiting.append(packed(message))
                if len(waiting) == BLOCK_FRAMES:
                    yield b"".join(waiting)
                    waiting.clear()
    if waiting:
        yield b"".join(waiting)

"""Frames in files of other tools: those of `plumb.link.frame_formats`.

They are decoded in a process of their own with limits (`plumb.files.bounded_reader`). Frames of CAN FD are left out:
plumb has none.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import numpy as np

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.files import input_files
from plumb.files.bounded_reader import pieces_of
from plumb.link.foreign_frame_reader import FRAMES
from plumb.link.frame_formats import table
from plumb.link.frame_records import FRAME, Frames

MOST_BYTES = 1 << 30
_READER = "plumb.link.foreign_frame_reader:pieces"


def blocks_in(path: Path, advice: str, notes: list[str] | None = None) -> Generator[Frames, None, None]:
    """The frames of a file, block by block. Closing the generator ends the reading. notes: takes a sentence for all
    that the user should know of how the file was read.

    Raises UsageError, with the advice, for a file that cannot be read.
    """
    input_files.check(path, MOST_BYTES, advice)
    if table.format_of(path) is table.MF4:
        require_mf4()
    for piece in pieces_of(_READER, path, advice):
        if piece[:1] == FRAMES:
            yield np.frombuffer(piece[1:], FRAME)
        elif notes is not None:
            notes.append(piece[1:].decode("utf-8", "replace"))


def require_mf4() -> None:
    """Raises UsageError when the library for MF4 is not installed."""
    try:
        import asammdf  # noqa: F401
    except ImportError:
        raise UsageError(f"MF4 needs asammdf; install it {install_hint('mf4')}") from None

"""Frames in files of other tools: BLF, ASC, TRC, candump, python-can's CSV, and MF4.

python-can and asammdf decode them, in a process of their own with limits (`plumb.files.bounded_reader`). Frames of CAN
FD are left out: plumb has none.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import numpy as np

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.files import input_files
from plumb.files.bounded_reader import pieces_of
from plumb.link.frame_records import FRAME, Frames

READ = (".asc", ".blf", ".log", ".trc", ".mf4")
"""Suffixes of the files that are read; .log is candump's."""
MOST_BYTES = 1 << 30
_READER = "plumb.link.foreign_frame_reader:pieces"


def blocks_in(path: Path, advice: str) -> Generator[Frames, None, None]:
    """The frames of a file, block by block. Closing the generator ends the reading.

    Raises UsageError, with the advice, for a file that cannot be read.
    """
    input_files.check(path, MOST_BYTES, advice)
    for piece in pieces_of(_READER, path, advice):
        yield np.frombuffer(piece, FRAME)


def require_mf4() -> None:
    """Raises UsageError when the library for MF4 is not installed."""
    try:
        import asammdf  # noqa: F401
    except ImportError:
        raise UsageError(f"MF4 needs asammdf; install it {install_hint('mf4')}") from None

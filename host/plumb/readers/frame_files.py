"""Files of frames that other tools write and read, in the formats of `plumb.link.frame_formats`.

Such a file has no DBC and no identity; the messages are those of this version of plumb. Its parameters are those that
its own frames carry.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from plumb.errors import UsageError
from plumb.link.foreign_frames import blocks_in
from plumb.readers.log_file import BLOCK_FRAMES, FRAME, Frames, Log
from plumb.spec.protocol import protocol

MOST_MEMORY = 32 << 20
"""Bytes of a file's frames that are held in memory; more are spooled to a temporary file."""
_ADVICE = "give a log of `plumb record`, or a file of frames of a CAN tool"


def read_frames(path: Path) -> Log:
    """The frames of a file as a log without identity. Raises UsageError for a file that cannot be read."""
    spool = tempfile.SpooledTemporaryFile(MOST_MEMORY)  # noqa: SIM115 (the log reads it as long as it lives)
    count = 0
    notes: list[str] = []
    for frames in blocks_in(path, _ADVICE, notes):
        spool.write(frames.tobytes())
        count += len(frames)
    if not count:
        raise UsageError(f"{path} holds no frame; {_ADVICE}")
    head: dict[str, object] = {"protocol": {"dbc_hash": f"0x{protocol().dbc_hash:08x}"}}
    return Log(path, head, blocks=lambda: _blocks_of(spool), count=count, done={}, notes=notes)


def _blocks_of(spool: IO[bytes]) -> Iterator[Frames]:
    """The frames of a spool from its beginning. Several readers may go through it at once."""
    at = 0
    while True:
        spool.seek(at)
        data = spool.read(BLOCK_FRAMES * FRAME.itemsize)
        if not data:
            return
        at += len(data)
        yield np.frombuffer(data, FRAME)

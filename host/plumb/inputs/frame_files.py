"""Files of frames that other tools write and read: BLF, ASC, TRC, candump and MF4.

Such a file has no DBC and no identity; the messages are those of this version of plumb. Its parameters are those that
its own frames carry.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import can
import numpy as np

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.files import input_files
from plumb.inputs.log_file import BLOCK_FRAMES, ERROR, EXTENDED, FRAME, PACK, REMOTE, Frames, Log
from plumb.spec.protocol import protocol

READ = (".asc", ".blf", ".log", ".trc", ".mf4")
"""Suffixes of the files that are read; .log is candump's."""
MOST_MEMORY = 32 << 20
"""Bytes of a file's frames that are held in memory; more are spooled to a temporary file."""
MOST_BYTES = 1 << 30
_ADVICE = "give a log of `plumb record`, or a file of frames in the format of its suffix"
_EFF_MASK = (1 << 29) - 1


def read_frames(path: Path) -> Log:
    """The frames of a file as a log without identity. Raises UsageError for a file that cannot be read."""
    input_files.check(path, MOST_BYTES, _ADVICE)
    if path.suffix.lower() not in READ:
        raise UsageError(f"{path} is no file of frames, which end in {', '.join(READ)}; {_ADVICE}")
    if path.suffix.lower() == ".mf4":
        require_mf4()
    spool = tempfile.SpooledTemporaryFile(MOST_MEMORY)  # noqa: SIM115 (the log reads it as long as it lives)
    logging.getLogger("can").addHandler(logging.NullHandler())  # its readers log the lines that they do not understand
    count = 0
    try:
        with can.LogReader(path) as reader:
            for message in reader:
                if not message.is_fd and len(message.data or b"") <= 8:
                    spool.write(packed(message))
                    count += 1
    except Exception as error:  # python-can's readers raise many kinds of exceptions for a damaged file
        raise UsageError(f"{path} is damaged, or no {path.suffix} file ({type(error).__name__}); {_ADVICE}") from None
    if not count:
        raise UsageError(f"{path} holds no frame; {_ADVICE}")
    head: dict[str, object] = {"protocol": {"dbc_hash": f"0x{protocol().dbc_hash:08x}"}}
    return Log(path, head, blocks=lambda: _blocks_of(spool), count=count, done={})


def packed(message: can.Message) -> bytes:
    """A frame of any bus as a record of FRAME."""
    can_id = message.arbitration_id | EXTENDED * message.is_extended_id
    can_id |= REMOTE * message.is_remote_frame | ERROR * message.is_error_frame
    data = bytes(message.data or b"")[:8]
    return PACK(round(message.timestamp * 1e6), can_id, min(message.dlc, 8), not message.is_rx, data)


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


def require_mf4() -> None:
    """Raises UsageError when the library for MF4 is not installed."""
    try:
        import asammdf  # noqa: F401
    except ImportError:
        raise UsageError(f"MF4 needs asammdf; install it {install_hint('mf4')}") from None


def messages_of(frames: Frames) -> Iterator[can.Message]:
    """The frames as python-can has them, on channel 0."""
    for time_us, can_id, length, sent, data in frames.tolist():
        extended = bool(can_id & EXTENDED)
        yield can.Message(
            timestamp=time_us * 1e-6,
            arbitration_id=can_id & (_EFF_MASK if extended else 0x7FF),
            is_extended_id=extended,
            is_remote_frame=bool(can_id & REMOTE),
            is_error_frame=bool(can_id & ERROR),
            is_rx=not sent,
            dlc=length,
            data=None if can_id & REMOTE else bytes(data[:length]),
            channel=0,
        )

"""Frames of a bus as packed records, the form in which logs and foreign files of frames are handled block by block."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import can
import numpy as np
import numpy.typing as npt

FRAME = np.dtype([("time_us", "<i8"), ("can_id", "<u4"), ("length", "u1"), ("sent", "u1"), ("data", "u1", (8,))])
"""One frame. time_us: when it was received, by the clock of the head; can_id: as SocketCAN has it, with bit 31 for an
extended identifier, 30 for a remote frame, 29 for an error frame; sent: 1 when the recording host sent it."""
BLOCK_FRAMES = 4096
"""Frames of a full block: 90 KB, one second of a full UART."""
PACK = struct.Struct("<qIBB8s").pack
"""One record of FRAME; 8s pads with zeros."""
EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
_EFF_MASK = (1 << 29) - 1

Frames = npt.NDArray[np.void]
"""Records of FRAME, in the order in which they were received."""


def packed(message: can.Message) -> bytes:
    """A frame of any bus as a record of FRAME."""
    can_id = message.arbitration_id | EXTENDED * message.is_extended_id
    can_id |= REMOTE * message.is_remote_frame | ERROR * message.is_error_frame
    data = bytes(message.data or b"")[:8]
    return PACK(round(message.timestamp * 1e6), can_id, min(message.dlc, 8), not message.is_rx, data)


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

"""A board on any python-can bus, as a session wants it: whole frames, many at a time, trouble as one sentence.

The serial link has its own bus class (`plumb.serialbus`), the board simulated in this process another
(`plumb.f103.canbus`); everything else that python-can can open comes through here.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import can

from plumb.errors import LinkError
from plumb.protocol import Frame, check, protocol

SEND_TIMEOUT_S = 1.0


class FrameBus(Protocol):
    """What a session speaks through. clock: seconds that pass for what is at the other end. rejected: received frames
    that were thrown away."""

    clock: Callable[[], float]

    @property
    def rejected(self) -> int: ...

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]: ...

    def write_frames(self, frames: Sequence[Frame]) -> None: ...


class AnyBus:
    """A python-can bus as a FrameBus; the bus belongs to the caller."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.clock: Callable[[], float] = getattr(bus, "clock", time.monotonic)
        self.rejected = 0
        self._known = protocol().by_identifier

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """What has arrived with a right CRC, waiting up to timeout_s for the first frame. Others' traffic is let by."""
        frames: list[Frame] = []
        with self._explained():
            message = self.bus.recv(timeout_s)
            while message is not None:
                self._take(message, frames)
                message = self.bus.recv(0)
        return frames

    def _take(self, message: can.Message, frames: list[Frame]) -> None:
        frame = (message.arbitration_id, bytes(message.data))
        ours = not (message.is_extended_id or message.is_error_frame or message.is_remote_frame)
        if ours and frame[0] in self._known:
            if check(*frame):
                frames.append(frame)
            else:
                self.rejected += 1

    def write_frames(self, frames: Sequence[Frame]) -> None:
        with self._explained():
            for identifier, data in frames:
                message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
                self.bus.send(message, timeout=SEND_TIMEOUT_S)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except LinkError:
            raise
        except (can.CanError, OSError, ValueError) as error:
            reason = str(error).strip() or type(error).__name__
            raise LinkError(f"{self.bus.channel_info} failed ({reason}): check the interface and reconnect") from None

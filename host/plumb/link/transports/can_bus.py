"""Any python-can bus held to our manners, and as a session wants it: whole frames, many at a time.

The serial link has its own bus class (`plumb.link.transports.slcan_bus`), socketcand one
(`plumb.link.transports.socketcand`), the board simulated in this process another (`plumb.boards.virtual_can`);
everything else that python-can can open comes through here.
"""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, runtime_checkable

import can
from can.typechecking import CanFilters

from plumb.errors import LinkError
from plumb.link.transports.byte_stream import ClosedError
from plumb.spec.protocol import Frame, check, protocol

SEND_TIMEOUT_S = 1.0
FULL_WAIT_S = 0.0005
"""About two frames at 500 kbit/s."""
MALFORMED_IN_A_ROW = 8
"""So many pieces of text without a frame between them are no noise on the line but another kind of line."""


@runtime_checkable
class FrameBus(Protocol):
    """What a session speaks through. clock: seconds that pass for what is at the other end. rejected: received frames
    that were thrown away."""

    clock: Callable[[], float]

    @property
    def rejected(self) -> int: ...

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]: ...

    def write_frames(self, frames: Sequence[Frame]) -> None: ...


@contextlib.contextmanager
def explained(name: str) -> Iterator[None]:
    """Whatever a driver raises, as one sentence that is a LinkError and one of python-can's errors, too."""
    try:
        yield
    except LinkError:
        raise
    except Exception as error:  # interfaces raise whatever their drivers do
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise ClosedError(f"{name} failed ({reason}): check the interface and reconnect") from None


class DriverBus(can.BusABC):
    """One of python-can's interfaces, opened under a name: its trouble is a ClosedError of one sentence, a malformed
    line costs that line (`malformed` counts them), and closing it never fails."""

    def __init__(self, name: str, driver: can.BusABC, can_filters: CanFilters | None = None) -> None:
        self._driver = driver
        self.malformed = self._in_a_row = 0
        self.channel_info = name
        super().__init__(name, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Waits for room, SEND_TIMEOUT_S unless told otherwise: a network interface of Linux queues ten frames by
        default, and says of the next that there is no buffer space, whatever time-out the driver was given."""
        end = time.monotonic() + (SEND_TIMEOUT_S if timeout is None else timeout)
        with explained(self.channel_info):
            while True:
                try:
                    return self._driver.send(msg, timeout)
                except (can.CanError, OSError) as error:
                    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
                    if number != errno.ENOBUFS or time.monotonic() >= end:
                        raise
                time.sleep(FULL_WAIT_S)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        with explained(self.channel_info):
            try:
                message = self._driver.recv(timeout)
            except (ValueError, IndexError):  # what python-can's slcan raises for a line that is no frame
                self.malformed += 1
                self._in_a_row += 1
                if self._in_a_row >= MALFORMED_IN_A_ROW:
                    raise
                return None, False
            if message is not None:
                self._in_a_row = 0
            return message, False

    def shutdown(self) -> None:
        """Close the driver; safe to call twice, and when the device is gone already."""
        if not self._is_shutdown:
            super().shutdown()
            with contextlib.suppress(Exception):
                self._driver.shutdown()


class AnyBus:
    """A python-can bus as a FrameBus; the bus belongs to the caller."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.clock: Callable[[], float] = getattr(bus, "clock", time.monotonic)
        self._rejected = 0
        self._known = protocol().by_identifier

    @property
    def rejected(self) -> int:
        """Frames with a wrong CRC, and text that was no frame."""
        return self._rejected + int(getattr(self.bus, "malformed", 0))

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """What has arrived with a right CRC, waiting up to timeout_s for the first frame. Others' traffic is let by."""
        frames: list[Frame] = []
        with explained(self.bus.channel_info):
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
                self._rejected += 1

    def write_frames(self, frames: Sequence[Frame]) -> None:
        with explained(self.bus.channel_info):
            for identifier, data in frames:
                message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
                self.bus.send(message, timeout=SEND_TIMEOUT_S)

"""Adapter from any python-can bus to the frame interface of a session, with errors of one sentence.

The serial link (`plumb.link.transports.slcan_bus`), socketcand (`plumb.link.transports.socketcand`) and the board
simulated in this process (`plumb.boards.virtual_can`) have bus classes of their own; every other interface of
python-can is used through this module.
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
"""Pause before a frame is sent again after the driver's queue was full: about two frames at 500 kbit/s."""
MALFORMED_IN_A_ROW = 8
"""Malformed lines in a row after which the port is taken for something other than an SLCAN adapter."""


@runtime_checkable
class FrameBus(Protocol):
    """The bus as a session uses it. clock: time in seconds, simulated for a simulated board. rejected: number of
    received frames that were discarded."""

    clock: Callable[[], float]

    @property
    def rejected(self) -> int: ...

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]: ...

    def write_frames(self, frames: Sequence[Frame]) -> None: ...


@contextlib.contextmanager
def explained(name: str) -> Iterator[None]:
    """Convert any exception of a driver to a ClosedError of one sentence, which is also an error class of
    python-can."""
    try:
        yield
    except LinkError:
        raise
    except Exception as error:  # interfaces raise whatever their drivers do
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise ClosedError(f"{name} failed ({reason}): check the interface and reconnect") from None


class DriverBus(can.BusABC):
    """A bus of one of python-can's interfaces. An exception of the driver becomes a ClosedError of one sentence, a
    malformed line is skipped and counted in `malformed`, and closing never fails."""

    def __init__(self, name: str, driver: can.BusABC, can_filters: CanFilters | None = None) -> None:
        self._driver = driver
        self.malformed = self._in_a_row = 0
        self.channel_info = name
        super().__init__(name, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, waiting up to `timeout` (default SEND_TIMEOUT_S) for room in the driver's queue. A network
        interface of Linux queues ten frames by default and fails with ENOBUFS for the next, whatever the time-out."""
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
            except (ValueError, IndexError):  # python-can's slcan raises these for a line that is not a frame
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
        """Number of frames with a wrong CRC and of malformed lines."""
        return self._rejected + int(getattr(self.bus, "malformed", 0))

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """The frames of plumb that have arrived with a right CRC, waiting up to timeout_s for the first. Other traffic
        on the bus is ignored."""
        frames: list[Frame] = []
        with explained(self.bus.channel_info):
            message = self.bus.recv(timeout_s)
            while message is not None:
                self._append_valid(message, frames)
                message = self.bus.recv(0)
        return frames

    def _append_valid(self, message: can.Message, frames: list[Frame]) -> None:
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

"""The serial link as a python-can bus: `can.Bus(interface="plumb", channel=...)`.

Compatible with other SLCAN tools. No received text raises an exception, no call blocks without a time-out, received
text is parsed in whole chunks, and frames with a wrong CRC are discarded (SLCAN itself has no checksum).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import can
from can.typechecking import CanFilters

from plumb.errors import LinkError
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.transports.byte_stream import Channel, ClosedError, DatagramStream, open_stream
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.link.transports.waiting_board import SET_UP, WAIT, AnsweringStream, is_perhaps_served
from plumb.spec.protocol import FRAME_DLC, Frame

_LONGEST_WAIT_S = 0.5


class PlumbBus(can.BusABC):
    """A board behind a serial port, a TCP socket or an in-process stream.

    channel: see `plumb.link.transports.byte_stream.open_stream`. tty_baudrate: of a serial port that does not name one.
    listen_only: telemetry only, the board refuses frames. Opening starts telemetry; closing stops it and disarms.
    bitrate is accepted because python-can passes it, and ignored: there is no CAN bus behind this link.

    There is no fileno() on purpose: received frames wait in this object, so select() on the port would miss them.
    """

    def __init__(
        self,
        channel: Channel,
        tty_baudrate: int = DEFAULT_BAUD,
        bitrate: int | None = None,
        listen_only: bool = False,
        can_filters: CanFilters | None = None,
        **kwargs: object,
    ) -> None:
        self._stream = open_stream(channel, tty_baudrate)
        self._answering = AnsweringStream(self._stream) if is_perhaps_served(self._stream) else None
        self.connectionless = isinstance(self._stream, DatagramStream)
        """Opening it says nothing about whether anybody is there."""
        self.parser = SlcanParser()
        self.clock = self._stream.clock
        self._frames: deque[Frame] = deque()
        self.channel_info = f"plumb on {self._stream.name}"
        try:
            # The first CR ends a line that was left unfinished; C closes a link that was left open.
            self._stream.write(b"\rC\r" + (b"L\r" if listen_only else b"O\r"))
            if self._answering is not None:
                self._stream.write(WAIT + b"\r")
                self._stream, self.clock = self._answering, self._answering.clock
        except LinkError:
            self._stream.close()
            raise
        super().__init__(self._stream.name, can_filters=can_filters, **kwargs)

    # ---- the frame interface, faster than that of python-can ----

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """The frames that have arrived, waiting up to timeout_s (of `clock`) for the first. Raises LinkError when
        closed."""
        if self._frames:
            frames = list(self._frames)
            self._frames.clear()
            return frames
        end = self.clock() + timeout_s
        remaining = timeout_s
        while True:
            data = self._stream.read(remaining)
            if data:
                frames = self.parser.feed(data)
                if frames:
                    return frames
            remaining = end - self.clock()
            if remaining <= 0 or not data:
                return []

    def write_frames(self, frames: Sequence[Frame]) -> None:
        """Send frames in one write. Raises LinkError."""
        self._stream.write(text_of_frames(frames))

    def set_up_plant(self) -> bool:
        """Ask the process that serves a simulated board to set its plant up anew; returns False for another board."""
        served = self._answering is not None and self._answering.marked
        if served:
            self._stream.write(SET_UP + b"\r")
        return served

    def write_text(self, text: bytes) -> None:
        """Send prepared SLCAN text. Raises LinkError."""
        self._stream.write(text)

    @property
    def rejected(self) -> int:
        """Number of lines that were not a frame, and of frames with a wrong CRC."""
        return self.parser.bad + self.parser.rejected

    # ---- python-can ----

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._frames:
            wait = _LONGEST_WAIT_S if timeout is None else max(0.0, min(timeout, _LONGEST_WAIT_S))
            self._frames.extend(self.read_frames(wait))
            if not self._frames:
                return None, False
        identifier, data = self._frames.popleft()
        return (
            can.Message(
                timestamp=time.time(),
                arbitration_id=identifier,
                is_extended_id=False,
                dlc=len(data),
                data=data,
                is_rx=True,
            ),
            False,
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one classic data frame with a standard identifier, unchanged. Raises ClosedError for any other kind."""
        if msg.is_extended_id or msg.is_remote_frame or msg.is_fd or msg.is_error_frame or msg.dlc > FRAME_DLC:
            raise ClosedError("only classic data frames with an 11-bit identifier go over this link")
        self.write_frames([(msg.arbitration_id, bytes(msg.data))])

    def flush_tx_buffer(self) -> None:
        """Does nothing: frames are written to the operating system at once."""

    def shutdown(self) -> None:
        """Stop telemetry (which disarms) and close. Safe to call twice, and after the port was unplugged."""
        if self._is_shutdown:
            return
        super().shutdown()
        try:
            self._stream.write(b"C\r")
        except LinkError:
            pass
        finally:
            self._stream.close()

"""SLCAN server as a python-can bus: behaves towards the host like a CAN adapter or a board.

It serves a `ServerEndpoint` (pty or TCP port), answers the commands of an adapter as docs/reference/protocol.md
describes, and passes frames in both directions. Frames are sent only while a host has the link open; others are
discarded.
"""

from __future__ import annotations

import time
from collections import deque

import can
from can.typechecking import CanFilters

from plumb.link.transports.server_endpoint import ServerEndpoint, wait_readable
from plumb.link.transports.slcan import LINE_MAX, frame_of_line, text_of_frames
from plumb.spec.protocol import Frame

_CR, _BEL = b"\r", b"\a"
_RATES = {b"S4": 125, b"S5": 250, b"S6": 500, b"S8": 1000}
_LOOK_S = 0.01
"""Interval at which a pty is polled for a client: opening one makes no descriptor readable."""


class AdapterBus(can.BusABC):
    """An SLCAN adapter. open: the host has opened the link (O or L). read_only: it opened it with L, and its frames are
    refused. kbit: bit rate that the host has set (S4, S5, S6, S8), None before. refused: unknown commands received."""

    def __init__(self, line: ServerEndpoint, can_filters: CanFilters | None = None) -> None:
        self._line = line
        self._pending = b""
        self._frames: deque[Frame] = deque()
        self.open = self.read_only = False
        self.refused = 0
        self.kbit: int | None = None
        self.address = line.address
        self.channel_info = f"SLCAN on {line.address}"
        super().__init__(line.address, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._serve()
        if self.open:
            self._line.write(text_of_frames([(msg.arbitration_id, bytes(msg.data))]))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            self._serve()
            if self._frames:
                identifier, data = self._frames.popleft()
                message = can.Message(
                    timestamp=time.time(), arbitration_id=identifier, is_extended_id=False, dlc=len(data), data=data
                )
                return message, False
            remaining = _LOOK_S if end is None else end - time.monotonic()
            if remaining <= 0:
                return None, False
            wait_readable(self._line.watch(), min(remaining, _LOOK_S))

    def _serve(self) -> None:
        """Read what the host has sent: queue its frames and answer its commands."""
        if self._line.watch() is None:
            self.open, self._pending = False, b""  # the client that had opened the link disconnected
        data = self._line.read()
        *lines, self._pending = (self._pending + data.replace(_BEL, _CR)).split(_CR)
        self._pending = self._pending[: LINE_MAX + 1]
        answer = b"".join(map(self._answer, lines))
        if answer:
            self._line.write(answer)

    def _answer(self, text: bytes) -> bytes:
        frame = frame_of_line(text) if self.open and not self.read_only else None
        if frame is not None:
            self._frames.append(frame)
            return _CR
        if text in (b"O", b"L", b"C"):
            self.open, self.read_only = text != b"C", text == b"L"
        elif text == b"V":
            return b"V0101\r"
        elif text == b"N":
            return b"N0000\r"
        elif text in _RATES:
            self.kbit = _RATES[text]
        elif text[:1] not in (b"S", b"s", b""):
            self.refused += 1
            return _BEL
        return _CR

    def shutdown(self) -> None:
        """Close the line; safe to call twice."""
        if not self._is_shutdown:
            super().shutdown()
            self._line.close()

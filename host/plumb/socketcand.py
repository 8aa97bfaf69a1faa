"""The far end of python-can's `socketcand` interface: one CAN bus behind a TCP port of this machine.

The text protocol of socketcand in raw mode, as far as python-can speaks it: `< hi >`, `< open NAME >`, `< rawmode >`,
`< send ID LENGTH BYTES >`, `< frame ID SECONDS DATA >`. Any name opens the one bus there is. One client at a time.
"""

from __future__ import annotations

import re
import time
from collections import deque

import can

from plumb.line import TcpLine

_COMMAND = re.compile(rb"<\s*([^<>]*?)\s*>")
_LONGEST = 4096


class SocketcandBus(can.BusABC):
    """What a client of `can.Bus(interface="socketcand", host="127.0.0.1", port=..., channel=...)` talks to."""

    def __init__(self, port: int) -> None:
        self._line = TcpLine(port)
        self._text = b""
        self._greeted = self._raw = False
        self._received: deque[can.Message] = deque()
        host, _, number = self._line.address.removeprefix("socket://").rpartition(":")
        self.address = f"{host}:{number}"
        self.channel_info = f"socketcand on {self.address}"
        super().__init__(self.address)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._serve()
        if self._raw:
            identifier = f"{msg.arbitration_id:08X}" if msg.is_extended_id else f"{msg.arbitration_id:03X}"
            self._line.write(f"< frame {identifier} {msg.timestamp:.6f} {bytes(msg.data).hex().upper()} >".encode())

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            self._serve()
            if self._received:
                return self._received.popleft(), False
            if end is not None and time.monotonic() >= end:
                return None, False
            time.sleep(0.0005)

    def _serve(self) -> None:
        """Greet who has come, take what was said and answer it."""
        data = self._line.read()
        if not self._line.connected:
            self._greeted = self._raw = False
            self._text = b""
            return
        if not self._greeted:
            self._greeted = True
            self._line.write(b"< hi >")
        self._text = (self._text + data)[-_LONGEST:]
        end = 0
        for match in _COMMAND.finditer(self._text):
            self._obey(match[1].split())
            end = match.end()
        self._text = self._text[end:]

    def _obey(self, words: list[bytes]) -> None:
        verb = words[0] if words else b""
        if verb in (b"open", b"rawmode"):
            self._raw = self._raw or verb == b"rawmode"
            self._line.write(b"< ok >")
            return
        try:
            if verb != b"send":
                raise ValueError(verb)
            identifier, length = int(words[1], 16), int(words[2], 16)
            data = bytes(int(word, 16) for word in words[3 : 3 + length])
            extended = len(words[1]) > 3
            self._received.append(can.Message(arbitration_id=identifier, is_extended_id=extended, data=data))
        except (ValueError, IndexError):
            self._line.write(b"< error unknown command >")

    def shutdown(self) -> None:
        """Close the port; safe to call twice."""
        if not self._is_shutdown:
            super().shutdown()
            self._line.close()

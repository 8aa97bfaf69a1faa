"""Server and client of socketcand: a CAN bus behind a TCP port.

The text protocol in raw mode: `< hi >`, `< open NAME >`, `< rawmode >`, `< send ID LENGTH BYTES >`,
`< frame ID SECONDS DATA >`. The server has one client at a time, for example python-can's own interface, and opens its
only bus under any name. The client replaces python-can's interface, which waits without a time-out for the server's
greeting and does not notice a server that has disconnected.
"""

from __future__ import annotations

import re
import time
from collections import deque

import can

from plumb.link.transports.byte_stream import ClosedError, OpenError, SocketStream
from plumb.link.transports.server_endpoint import TcpEndpoint

_COMMAND = re.compile(rb"<\s*([^<>]*?)\s*>")
_LONGEST = 4096
_GREETING_S = 5.0
_LONGEST_WAIT_S = 0.5


class SocketcandBus(can.BusABC):
    """Server for clients such as `can.Bus(interface="socketcand", host="127.0.0.1", port=..., channel=...)`."""

    def __init__(self, port: int) -> None:
        self._line = TcpEndpoint(port)
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
        """Greet a new client, and answer the commands that have arrived."""
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
            self._answer(match[1].split())
            end = match.end()
        self._text = self._text[end:]

    def _answer(self, words: list[bytes]) -> None:
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


class SocketcandClient(can.BusABC):
    """Client: the bus that the socketcand server at host:port calls `name`. malformed: texts that were not a frame."""

    def __init__(self, host: str, port: int, name: str) -> None:
        self._stream = SocketStream(host, port)
        self._text = b""
        self._received: deque[can.Message] = deque()
        self.malformed = 0
        self.channel_info = f"can:socketcand:{host}:{port}:{name}"
        try:
            self._expect("hi")
            for command in (f"open {name}", "rawmode"):
                self._stream.write(f"< {command} >".encode())
                self._expect("ok")
        except BaseException:
            self._stream.close()
            raise
        super().__init__(name)

    def _expect(self, answer: str) -> None:
        end = time.monotonic() + _GREETING_S
        said = b""
        while (remaining := end - time.monotonic()) > 0 and len(said) < _LONGEST:
            said += self._stream.read(remaining)
            found = _COMMAND.search(said)
            if found is not None and found[1].decode(errors="replace") == answer:
                self._text = said[found.end() :]
                return
            if found is not None:
                break
        raise OpenError(f"{self._stream.name} is not a socketcand server with that bus: check the address")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if msg.is_remote_frame or msg.is_error_frame or msg.is_fd:
            raise ClosedError("only classic data frames go over socketcand")
        identifier = f"{msg.arbitration_id:08X}" if msg.is_extended_id else f"{msg.arbitration_id:03X}"
        data = " ".join(f"{byte:x}" for byte in msg.data)
        self._stream.write(f"< send {identifier} {len(msg.data):X} {data} >".encode())

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = time.monotonic() + (_LONGEST_WAIT_S if timeout is None else timeout)
        while not self._received:
            self._parse(self._stream.read(max(0.0, end - time.monotonic())))
            if not self._received and time.monotonic() >= end:
                return None, False
        return self._received.popleft(), False

    def _parse(self, data: bytes) -> None:
        self._text += data
        end = 0
        for match in _COMMAND.finditer(self._text):
            words = match[1].split()
            end = match.end()
            try:
                if words[0] != b"frame":
                    continue  # an error frame, or an answer
                identifier, timestamp = int(words[1], 16), float(words[2])
                body = bytes.fromhex(words[3].decode()) if len(words) > 3 else b""
                message = can.Message(timestamp, identifier, is_extended_id=len(words[1]) > 3, data=body, check=True)
                self._received.append(message)
            except (ValueError, IndexError):
                self.malformed += 1
        self._text = self._text[end:]
        if len(self._text) > _LONGEST:
            self._text, self.malformed = b"", self.malformed + 1

    def shutdown(self) -> None:
        """Close the connection; safe to call twice."""
        if not self._is_shutdown:
            super().shutdown()
            self._stream.close()

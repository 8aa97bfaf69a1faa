"""Client of socketcand: a CAN bus behind a TCP port, its text protocol in raw mode (`socketcand_server` has the other
end).

The client replaces python-can's interface, which waits without a time-out for the server's greeting and does not notice
a server that has disconnected.
"""

from __future__ import annotations

import re
import time
from collections import deque

import can

from plumb.link.transports.byte_stream import ClosedError, OpenError, SocketStream

COMMAND = re.compile(rb"<\s*([^<>]*?)\s*>")
LONGEST_TEXT = 4096
_GREETING_S = 5.0
_LONGEST_WAIT_S = 0.5


def frame_text(message: can.Message) -> bytes:
    """`< frame ID SECONDS DATA >`, as a server sends it."""
    identifier = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
    return f"< frame {identifier} {message.timestamp:.6f} {bytes(message.data).hex().upper()} >".encode()


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
        while (remaining := end - time.monotonic()) > 0 and len(said) < LONGEST_TEXT:
            said += self._stream.read(remaining)
            found = COMMAND.search(said)
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
        for match in COMMAND.finditer(self._text):
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
        if len(self._text) > LONGEST_TEXT:
            self._text, self.malformed = b"", self.malformed + 1

    def shutdown(self) -> None:
        """Close the connection; safe to call twice."""
        if not self._is_shutdown:
            super().shutdown()
            self._stream.close()

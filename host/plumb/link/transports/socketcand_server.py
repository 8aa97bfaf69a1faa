"""Server of socketcand: a CAN bus behind a TCP port, for several clients at once.

The text protocol in raw mode: `< hi >`, `< open NAME >`, `< rawmode >`, `< echo >`, `< send ID LENGTH BYTES >`,
`< frame ID SECONDS DATA >`. Clients are python-can's own interface, SavvyCAN and plumb itself. The only bus is
opened under any name. Every client in raw mode receives the frames of the bus and those of the other
clients, as nodes on a wire do: a client that only listens sees the telemetry that another one has asked for.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque

import can

from plumb.link.transports.server_endpoint import Backlog, listening_socket
from plumb.link.transports.socketcand import COMMAND, LONGEST_TEXT, frame_text

MOST_CLIENTS = 16
_LOOK_S = 0.005
"""Longest wait for bytes before new clients are looked for."""


class _Client:
    """One connection. raw: it has asked for frames. left: it has disconnected."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.raw = self.left = False
        self._text = b""
        self._backlog = Backlog()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.write(b"< hi >")

    def write(self, data: bytes) -> None:
        """Send text; what a client that does not read would have waiting beyond the backlog is dropped, in whole
        pieces."""
        self._backlog.add(data)
        self.flush()

    def flush(self) -> None:
        try:
            self._backlog.flush(self.connection.send)
        except OSError:
            self.left = True

    def commands(self) -> list[list[bytes]]:
        """The words of every command that has arrived."""
        try:
            data = self.connection.recv(1 << 16)
            self.left = not data
        except BlockingIOError:
            return []
        except OSError:
            self.left = True
            return []
        self._text += data
        found, end = [], 0
        for match in COMMAND.finditer(self._text):
            found.append(match[1].split())
            end = match.end()
        self._text = self._text[end:][-LONGEST_TEXT:]
        return found


class SocketcandBus(can.BusABC):
    """Server for clients such as `can.Bus(interface="socketcand", host="127.0.0.1", port=..., channel=...)`.

    raw_clients: number of clients in raw mode."""

    def __init__(self, port: int) -> None:
        self._server = listening_socket(port)
        self._clients: list[_Client] = []
        self._received: deque[can.Message] = deque()
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        self.channel_info = f"socketcand on {self.address}"
        super().__init__(self.address)

    @property
    def raw_clients(self) -> int:
        return sum(client.raw for client in self._clients)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._serve()
        self._spread(msg, None)

    def _spread(self, message: can.Message, sender: _Client | None) -> None:
        text = frame_text(message)
        for client in self._clients:
            if client.raw and client is not sender:
                client.write(text)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end_s = None if timeout is None else time.monotonic() + timeout
        while True:
            self._serve()
            if self._received:
                return self._received.popleft(), False
            remaining_s = _LOOK_S if end_s is None else end_s - time.monotonic()
            if remaining_s <= 0:
                return None, False
            waited_for = [self._server, *(client.connection for client in self._clients)]
            select.select(waited_for, [], [], min(remaining_s, _LOOK_S))

    def _serve(self) -> None:
        """Greet new clients, answer the commands that have arrived, and drop the clients that have left."""
        with contextlib.suppress(OSError):  # nobody is waiting
            while True:
                connection, _ = self._server.accept()
                if len(self._clients) < MOST_CLIENTS:
                    self._clients.append(_Client(connection))
                else:
                    connection.close()
        for client in self._clients:
            client.flush()
            for words in client.commands():
                self._answer(client, words)
        for client in [client for client in self._clients if client.left]:
            client.connection.close()
            self._clients.remove(client)

    def _answer(self, client: _Client, words: list[bytes]) -> None:
        verb = words[0] if words else b""
        if verb in (b"open", b"rawmode"):
            client.raw = client.raw or verb == b"rawmode"
            client.write(b"< ok >")
            return
        if verb == b"echo":
            client.write(b"< echo >")
            return
        try:
            message = _sent_frame(words)
        except (ValueError, IndexError):
            client.write(b"< error unknown command >")
            return
        self._received.append(message)
        self._spread(message, client)

    def shutdown(self) -> None:
        """Close the port; safe to call twice."""
        if not self._is_shutdown:
            super().shutdown()
            for client in self._clients:
                client.connection.close()
            self._server.close()


def _sent_frame(words: list[bytes]) -> can.Message:
    """The frame of `send ID LENGTH BYTES`; raises ValueError or IndexError for anything else."""
    if not words or words[0] != b"send":
        raise ValueError("no command to send")
    identifier, length = int(words[1], 16), int(words[2], 16)
    data = bytes(int(word, 16) for word in words[3 : 3 + length])
    if len(data) != length:
        raise ValueError("fewer bytes than announced")
    extended = len(words[1]) > 3
    return can.Message(time.time(), identifier, is_extended_id=extended, data=data, check=True)

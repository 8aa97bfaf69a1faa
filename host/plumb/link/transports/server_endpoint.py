"""The far end of a cable: a pseudo-terminal or a TCP port that a host opens, without a board behind it yet.

One client at a time: on TCP a second one is turned away at once. Clients come and go. What is written while nobody
listens is lost, as on a cable; a client that is there and busy finds it later, as in the buffer of a serial driver.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from plumb.errors import LinkError, UsageError

BACKLOG_BYTES = 1 << 16
"""Kept for a client that does not read: 0.7 s of a full line of 921600 baud. A pseudo-terminal alone keeps 4 KiB."""


class Line(Protocol):
    """The host's cable. Bytes are taken when there are some; nothing here waits."""

    address: str

    def watch(self) -> int | None:
        """File descriptor that becomes readable when something happens."""
        ...

    def read(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class Backlog:
    """What the client has yet to take. Beyond BACKLOG_BYTES whole pieces are lost."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def add(self, data: bytes) -> None:
        if len(self._bytes) + len(data) <= BACKLOG_BYTES:
            self._bytes += data

    def clear(self) -> None:
        self._bytes.clear()

    def __len__(self) -> int:
        return len(self._bytes)

    def give(self, write: Callable[[bytes], int]) -> None:
        """As much as write takes now; it says how much that was. Raises what write raises, but for a full buffer."""
        with contextlib.suppress(BlockingIOError):
            while self._bytes and (taken := write(bytes(self._bytes))):
                del self._bytes[:taken]


class PtyLine:
    """A pseudo-terminal. `link` is a stable name for it, replaced when it exists as a symbolic link."""

    def __init__(self, link: Path | None = None) -> None:
        try:
            import pty
            import tty
        except ImportError as error:
            raise UsageError("this system has no pseudo-terminals; serve on tcp:PORT") from error
        self._master, slave = pty.openpty()
        self.address = os.ttyname(slave)
        tty.setraw(slave)
        os.close(slave)  # from here on the client's opening and closing shows
        os.set_blocking(self._master, False)
        self._backlog = Backlog()
        self._link = link
        if link is not None:
            if link.exists() and not link.is_symlink():
                raise UsageError(f"{link} exists and is not a link to a terminal; choose another name")
            with contextlib.suppress(FileNotFoundError):
                link.unlink()
            try:
                link.symlink_to(self.address)
            except OSError as error:
                raise UsageError(f"the link {link} cannot be made: {error.strerror}") from error

    def _client(self) -> bool:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def watch(self) -> int | None:
        return self._master if self._client() else None

    def read(self) -> bytes:
        if self._backlog:
            self.write(b"")
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing there, or nobody
            return b""

    def write(self, data: bytes) -> None:
        if not self._client():
            self._backlog.clear()
            return
        self._backlog.add(data)
        with contextlib.suppress(OSError):
            self._backlog.give(lambda waiting: os.write(self._master, waiting))

    def close(self) -> None:
        os.close(self._master)
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()


class TcpLine:
    """A TCP port on this machine; 0 takes a free one."""

    def __init__(self, port: int) -> None:
        self._client: socket.socket | None = None
        self._next: socket.socket | None = None
        """Who came when the one before had just gone: served from the next read on, so that the change shows."""
        self._backlog = Backlog()
        try:
            self._server = socket.create_server(("127.0.0.1", port), backlog=1)
        except OSError as error:
            raise LinkError(_no_port(port, error)) from None
        self._server.setblocking(False)
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    @property
    def connected(self) -> bool:
        return self._client is not None

    def watch(self) -> int | None:
        return (self._client or self._server).fileno()

    def read(self) -> bytes:
        came, self._next = self._next or self._accepted(), None
        if came is not None and self._client is not None:
            data = self._taken()  # who left before this one came is let go first
            if self._client is None:
                self._next = came
            else:
                came.close()  # it would wait without end, and is told so
            return data
        if came is not None:
            self._client = came
        if self._backlog:
            self.write(b"")
        return self._taken()

    def _accepted(self) -> socket.socket | None:
        with contextlib.suppress(OSError):  # nobody waits
            client, _ = self._server.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return client
        return None

    def _taken(self) -> bytes:
        """What the client has said. One that has gone is let go."""
        data = b""
        try:
            while self._client is not None and len(data) < BACKLOG_BYTES:
                piece = self._client.recv(4096)
                data += piece
                if not piece:
                    self._hang_up()
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()
        return data

    def write(self, data: bytes) -> None:
        if self._client is not None:
            self._backlog.add(data)
            try:
                self._backlog.give(self._client.send)
            except OSError:
                self._hang_up()

    def _hang_up(self) -> None:
        self._backlog.clear()
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        self._hang_up()
        if self._next is not None:
            self._next.close()
        self._server.close()


class UdpLine:
    """A UDP port on this machine: answers go to whoever spoke last. What a datagram holds is text, as on a cable."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peer: tuple[str, int] | None = None
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise LinkError(_no_port(port, error)) from None
        self._socket.setblocking(False)
        self.address = f"udp:{self._socket.getsockname()[1]}"

    def watch(self) -> int | None:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            data, self._peer = self._socket.recvfrom(65535)
        except OSError:  # nothing there, or the peer went away
            return b""
        return data

    def write(self, data: bytes) -> None:
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._peer)

    def close(self) -> None:
        self._socket.close()


def _no_port(port: int, error: OSError) -> str:
    reason = os.strerror(error.errno) if error.errno else str(error)
    return f"port {port} on 127.0.0.1 cannot be opened ({reason}): another program serves there, or choose another port"


def open_line(spec: str, link: Path | None = None) -> Line:
    """'pty' or 'tcp:PORT'; raises UsageError for anything else."""
    kind, _, port = spec.partition(":")
    if spec == "pty":
        return PtyLine(link)
    if kind == "tcp" and port.isdigit() and int(port) <= 65535:
        return TcpLine(int(port))
    raise UsageError(f"'{spec}' is no line to serve on; write pty or tcp:PORT, up to 65535")

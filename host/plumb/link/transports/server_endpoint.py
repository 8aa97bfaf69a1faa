"""Listening side of a pty, TCP or UDP port: a host opens it as it would open the port of a board.

An endpoint has one client at a time; on TCP a second client is refused at once. Bytes written while no client is
connected are lost, as on a cable. A client that is connected but busy finds them later, as in the buffer of a serial
driver, up to BACKLOG_BYTES.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from plumb.errors import LinkError, UsageError
from plumb.link.endpoint_names import PtyName, TcpName, parse_endpoint

BACKLOG_BYTES = 1 << 16
"""Bytes kept for a client that does not read: 0.7 s at 921600 baud. A pseudo-terminal itself keeps 4 KiB."""


NO_TERMINAL = "--symlink names a terminal, and none is made here: serve on a pty, or leave --symlink out"


class ServerEndpoint(Protocol):
    """Listening side of a port. No call blocks.

    address: what the host opens, as pyserial names it.
    """

    address: str

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        ...

    def watch(self) -> int | None:
        """File descriptor that becomes readable when there is something to read; None while there is none to wait
        for."""
        ...

    def read(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


def wait_readable(descriptor: int | None, timeout_s: float) -> None:
    """Wait until there is something to read, or for the time-out. None: nothing can be read; select of Windows refuses
    to wait for nothing."""
    if descriptor is None:
        time.sleep(timeout_s)
    else:
        select.select([descriptor], [], [], timeout_s)


class Backlog:
    """Bytes that the client has not read yet. A write that would exceed BACKLOG_BYTES is dropped whole."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def add(self, data: bytes) -> None:
        if len(self._bytes) + len(data) <= BACKLOG_BYTES:
            self._bytes += data

    def clear(self) -> None:
        self._bytes.clear()

    def __len__(self) -> int:
        return len(self._bytes)

    def flush(self, write: Callable[[bytes], int]) -> None:
        """Call `write` until it accepts no more; it returns the number of bytes accepted. Raises what `write` raises,
        except BlockingIOError."""
        with contextlib.suppress(BlockingIOError):
            while self._bytes and (taken := write(bytes(self._bytes))):
                del self._bytes[:taken]


class PtyEndpoint:
    """A pseudo-terminal. link: symbolic link to create to it, replacing an older link of that name."""

    def __init__(self, link: Path | None = None) -> None:
        try:
            import pty
            import tty
        except ImportError as error:
            raise UsageError("this system has no pseudo-terminals; serve on tcp:PORT") from error
        self._master, slave = pty.openpty()
        self.address = os.ttyname(slave)
        tty.setraw(slave)
        os.close(slave)  # the poll below then sees clients open and close it
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

    @property
    def connected(self) -> bool:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def watch(self) -> int | None:
        return self._master if self.connected else None

    def read(self) -> bytes:
        if self._backlog:
            self.write(b"")
        try:
            return os.read(self._master, 4096)
        except OSError:  # no bytes, or no client
            return b""

    def write(self, data: bytes) -> None:
        if not self.connected:
            self._backlog.clear()
            return
        self._backlog.add(data)
        with contextlib.suppress(OSError):
            self._backlog.flush(lambda waiting: os.write(self._master, waiting))

    def close(self) -> None:
        os.close(self._master)
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()


def listening_socket(port: int) -> socket.socket:
    """A TCP port on the loopback address whose accept() does not block; raises LinkError."""
    try:
        server = socket.create_server(("127.0.0.1", port), backlog=1)
    except OSError as error:
        raise LinkError(_no_port(port, error)) from None
    server.setblocking(False)
    return server


class TcpEndpoint:
    """A TCP port on the loopback address; port 0 selects a free one."""

    def __init__(self, port: int) -> None:
        self._client: socket.socket | None = None
        self._next: socket.socket | None = None
        """A client accepted while the previous one disconnects becomes active on the next read, so the caller sees one
        empty read."""
        self._backlog = Backlog()
        self._server = listening_socket(port)
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    @property
    def connected(self) -> bool:
        return self._client is not None

    def watch(self) -> int | None:
        return (self._client or self._server).fileno()

    def read(self) -> bytes:
        new, self._next = self._next or self._accept(), None
        if new is not None and self._client is not None:
            data = self._receive()  # notices a client that left before the new one connected
            if self._client is None:
                self._next = new
            else:
                new.close()
            return data
        if new is not None:
            self._client = new
        if self._backlog:
            self.write(b"")
        return self._receive()

    def _accept(self) -> socket.socket | None:
        with contextlib.suppress(OSError):  # no client is waiting
            client, _ = self._server.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return client
        return None

    def _receive(self) -> bytes:
        """Bytes from the client; disconnects a client that has gone."""
        data = b""
        try:
            while self._client is not None and len(data) < BACKLOG_BYTES:
                piece = self._client.recv(4096)
                data += piece
                if not piece:
                    self._disconnect()
        except BlockingIOError:
            pass
        except OSError:
            self._disconnect()
        return data

    def write(self, data: bytes) -> None:
        if self._client is not None:
            self._backlog.add(data)
            try:
                self._backlog.flush(self._client.send)
            except OSError:
                self._disconnect()

    def _disconnect(self) -> None:
        self._backlog.clear()
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        self._disconnect()
        if self._next is not None:
            self._next.close()
        self._server.close()


class UdpEndpoint:
    """A UDP port on the loopback address. Answers go to the sender of the latest datagram; datagrams carry text."""

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

    @property
    def connected(self) -> bool:
        return self._peer is not None

    def watch(self) -> int | None:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            data, self._peer = self._socket.recvfrom(65535)
        except OSError:  # no datagram, or the peer is gone
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


def open_endpoint(spec: str | PtyName | TcpName, link: Path | None = None) -> ServerEndpoint:
    """pty or tcp:PORT, as text or parsed; raises UsageError for another text, and for a link without a pty."""
    name = parse_endpoint(spec) if isinstance(spec, str) else spec
    if link is not None and isinstance(name, TcpName):
        raise UsageError(NO_TERMINAL)
    return TcpEndpoint(name.port) if isinstance(name, TcpName) else PtyEndpoint(link)

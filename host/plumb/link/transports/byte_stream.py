"""Byte streams under the serial link: a serial port, a TCP socket, or an object in this process.

Each has `read(timeout_s)`, which gives what has arrived, waiting at most that long for the first byte; `write(data)`,
which gives up after two seconds; and `close()`. A failure raises a LinkError: one sentence that says what to do.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Protocol, runtime_checkable

from can import CanInitializationError, CanOperationError

from plumb.errors import LinkError, UsageError
from plumb.link.endpoint_names import SerialName, TcpName, UdpName, parse_network, split_rate
from plumb.link.port_holders import holders
from plumb.link.transports.serial_ports import check_port

WRITE_TIMEOUT_S = 2.0
CONNECT_TIMEOUT_S = 5.0
_CHUNK = 65536
_STANDSTILL_S = 2.0


class OpenError(LinkError, CanInitializationError):
    """The port could not be opened."""


class ClosedError(LinkError, CanOperationError):
    """The port was closed or unplugged, or accepts no data."""


class Stream(Protocol):
    """A byte stream, as the module describes. clock: time in seconds, simulated for a simulated board."""

    name: str
    clock: Callable[[], float]

    def read(self, timeout_s: float) -> bytes: ...
    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


class ByteChannel(Protocol):
    """An object of this process that a host reads and writes like a serial port: the UART of a simulated board. It may
    also have a name and clock_s(), its simulated time in seconds."""

    def read(self, size: int, /) -> bytes:
        """The bytes that have arrived, at most size; may advance simulated time to receive them."""

    def write(self, data: bytes, /) -> int | None: ...


@runtime_checkable
class ClockedChannel(Protocol):
    """A channel whose time is simulated."""

    def clock_s(self) -> float: ...


Channel = str | SerialName | TcpName | UdpName | ByteChannel
"""Endpoints that `open_stream` opens."""


class SocketStream:
    """A TCP connection to a virtual board served by another process."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        self.clock = time.monotonic
        try:
            self._socket = socket.create_connection((host, port), CONNECT_TIMEOUT_S)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OpenError(
                f"no connection to {self.name} ({reason}): start the board there, or check the address"
            ) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(WRITE_TIMEOUT_S)

    def read(self, timeout_s: float) -> bytes:
        with self._explained("broke"):
            if not select.select([self._socket], [], [], timeout_s)[0]:
                return b""
            data = self._socket.recv(_CHUNK)
            if not data:
                raise ConnectionResetError
            return data

    def write(self, data: bytes) -> None:
        with self._explained("accepts no data"):
            self._socket.sendall(data)

    @contextlib.contextmanager
    def _explained(self, what: str) -> Iterator[None]:
        try:
            yield
        except (ConnectionResetError, BrokenPipeError):
            raise ClosedError(
                f"the board at {self.name} closed the connection: "
                "start it again and reconnect, or close the other program that is connected to it"
            ) from None
        except (OSError, ValueError) as error:
            raise ClosedError(f"the connection to {self.name} {what} ({error}): start the board there again") from None

    def close(self) -> None:
        self._socket.close()


class DatagramStream:
    """The serial link's text in datagrams to a port of this machine. Without a server, datagrams are lost silently, as
    bytes on an open cable."""

    def __init__(self, port: int) -> None:
        self.name = f"udp:{port}"
        self.clock = time.monotonic
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))

    def read(self, timeout_s: float) -> bytes:
        with contextlib.suppress(OSError):  # refused: no server is there yet
            if select.select([self._socket], [], [], timeout_s)[0]:
                return self._socket.recv(_CHUNK)
        return b""

    def write(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self._socket.send(data)

    def close(self) -> None:
        self._socket.close()


def open_advice(port: str, error: Exception) -> str:
    """Error sentence for a port that does not open: the reason, and what to do."""
    text = str(error).lower()
    number = getattr(error, "errno", None)
    if "://" in port:
        return f"no connection to {port} ({_network_reason(text)}): check the address, and that a server runs there"
    if "inappropriate ioctl" in text:
        return f"{port} is not a serial port: `plumb ports` lists those of this machine"
    if number == 13 or "permission" in text or "access is denied" in text:
        return f"no permission to open {port}: add yourself to the group that owns it (often dialout) and log in again"
    if number == 16 or "busy" in text or "exclusively lock" in text:
        by = ", ".join(map(str, holders(port)))
        who = f" by {by}" if by else ""
        return f"{port} is in use{who}: close the other program (ModemManager holds new ports for some seconds)"
    if number == 2 or "no such file" in text or "could not open port" in text or "filenotfound" in text:
        return f"there is no port {port}: plug the board in, and list the ports with `plumb ports`"
    return f"{port} cannot be opened ({error}): check the port, or choose another with `plumb ports`"


def _network_reason(text: str) -> str:
    """Why a port behind a network did not open, from the lower-case text of pyserial's exception."""
    if "rfc2217 or binary" in text:
        return "the server does not speak RFC 2217"
    number = re.search(r"\[errno (-?\d+)\]", text)
    if number is None:
        return "timed out" if "timed out" in text else "the server refused the settings of the port"
    code = int(number[1])
    return os.strerror(code) if code > 0 else "the host is not known"


class SerialStream:
    """A serial port through pyserial; on POSIX it is read through select, without reconfiguring it for time-outs."""

    def __init__(self, port: str, baudrate: int) -> None:
        import serial

        check_port(port)
        self.name = port
        self.clock = time.monotonic
        try:
            self._port = serial.serial_for_url(
                port, baudrate, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True if os.name == "posix" else None
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise OpenError(open_advice(port, error)) from None
        self._fd: int | None = None
        if os.name == "posix":
            with contextlib.suppress(Exception):
                self._fd = self._port.fileno()

    def read(self, timeout_s: float) -> bytes:
        try:
            if self._fd is not None:
                if not select.select([self._fd], [], [], timeout_s)[0]:
                    return b""
                data = os.read(self._fd, _CHUNK)
                if not data:
                    raise OSError("it was unplugged")
                return data
            end = time.monotonic() + timeout_s
            while True:
                waiting: bytes = self._port.read(max(1, self._port.in_waiting))
                if waiting or time.monotonic() >= end:
                    return waiting
                time.sleep(0.0005)
        except (OSError, ValueError, TypeError) as error:
            raise ClosedError(f"{self.name} stopped working ({error}): plug the board in again") from None

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, ValueError, TypeError) as error:
            raise ClosedError(f"{self.name} accepts no data ({error}): plug the board in again") from None

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._port.close()


class ObjectStream:
    """A ByteChannel of this process: a virtual board's UART.

    Time-outs are measured with the object's clock_s(), if it has one, so that a run does not depend on this machine's
    speed.
    """

    def __init__(self, channel: ByteChannel) -> None:
        self.name = str(getattr(channel, "name", type(channel).__name__))
        self.clock: Callable[[], float] = channel.clock_s if isinstance(channel, ClockedChannel) else time.monotonic
        self._channel = channel

    def read(self, timeout_s: float) -> bytes:
        data = bytes(self._channel.read(_CHUNK))
        simulated = self.clock is not time.monotonic
        end, wall_end = self.clock() + timeout_s, time.monotonic() + max(timeout_s, _STANDSTILL_S)
        while not data and (before := self.clock()) < end:
            data = bytes(self._channel.read(_CHUNK))
            if data or (self.clock() != before and simulated):
                continue
            if simulated and time.monotonic() >= wall_end:
                raise ClosedError(
                    "the simulated board stands still: it sends no bytes and its time does not pass; start it again"
                )
            time.sleep(0.0002)
        return data

    def write(self, data: bytes) -> None:
        self._channel.write(data)

    def close(self) -> None:
        """Does nothing: the caller owns the object."""


def open_stream(channel: Channel, baudrate: int) -> Stream:
    """Open a channel: a parsed name, an object, or text (PORT, PORT@BAUD, socket://HOST:PORT, rfc2217://HOST:PORT,
    tcp:HOST:PORT, udp:PORT). baudrate: of a serial port without @BAUD. Raises OpenError, which is also an error class
    of python-can."""
    if isinstance(channel, SerialName):
        baudrate, channel = channel.baud, channel.port
    if isinstance(channel, str):
        try:
            if channel.startswith(("socket://", "tcp:", "udp:")):
                channel = parse_network(channel)
            else:
                channel, baud = split_rate(channel)
                baudrate = baudrate if baud is None else baud
        except UsageError as error:
            raise OpenError(str(error)) from None
    if isinstance(channel, TcpName):
        return SocketStream(channel.host, channel.port)
    if isinstance(channel, UdpName):
        return DatagramStream(channel.port)
    if not isinstance(channel, str):
        return ObjectStream(channel)
    return SerialStream(channel, baudrate)

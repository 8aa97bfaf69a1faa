"""The virtual board as a process of its own: its UART behind a pseudo-terminal or a TCP port, at the pace of the wall
clock and never faster. One client at a time; clients come and go, the board runs on. What the board sends while
nobody listens is lost, as on a cable."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Protocol

from plumb.errors import LinkError, UsageError
from plumb.f103.machine import Machine
from plumb.f103.timeline import TICKS_PER_S

SLICE_S = 0.0003
"""Rest between two turns of the loop, and so the grain of the pace."""
LAG_S = 0.05
"""When the machine cannot keep up by more than this, time is given up rather than chased."""


class Line(Protocol):
    """The host's cable. Bytes are taken when there are some; nothing here waits."""

    address: str

    def watch(self) -> int | None:
        """File descriptor that becomes readable when something happens."""
        ...

    def read(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class PtyLine:
    """A pseudo-terminal. `link` is a stable name for it, replaced when it exists as a symbolic link."""

    def __init__(self, link: Path | None = None) -> None:
        try:
            import pty
            import tty
        except ImportError as error:
            raise UsageError("this system has no pseudo-terminals; serve the board on tcp:PORT") from error
        self._master, slave = pty.openpty()
        self.address = os.ttyname(slave)
        tty.setraw(slave)
        os.close(slave)  # from here on the client's opening and closing shows
        os.set_blocking(self._master, False)
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
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing there, or nobody
            return b""

    def write(self, data: bytes) -> None:
        if self._client():
            with contextlib.suppress(OSError):
                os.write(self._master, data)

    def close(self) -> None:
        os.close(self._master)
        if self._link is not None and self._link.is_symlink():
            self._link.unlink()


class TcpLine:
    """A TCP port on this machine; 0 takes a free one."""

    def __init__(self, port: int) -> None:
        self._client: socket.socket | None = None
        try:
            self._server = socket.create_server(("127.0.0.1", port), backlog=1)
        except OSError as error:
            raise LinkError(f"port {port} on 127.0.0.1 cannot be opened: {error.strerror}; choose another") from error
        self._server.setblocking(False)
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def watch(self) -> int | None:
        return (self._client or self._server).fileno()

    def read(self) -> bytes:
        if self._client is None:
            with contextlib.suppress(OSError):
                self._client, _ = self._server.accept()
                self._client.setblocking(False)
                self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b""
        try:
            data = self._client.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def write(self, data: bytes) -> None:
        if self._client is not None:
            try:
                self._client.send(data)
            except BlockingIOError:
                return  # the client does not read: lost, as on a cable
            except OSError:
                self._hang_up()

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        self._hang_up()
        self._server.close()


def open_line(spec: str, link: Path | None = None) -> Line:
    """'pty' or 'tcp:PORT'; raises UsageError for anything else."""
    kind, _, port = spec.partition(":")
    if spec == "pty":
        return PtyLine(link)
    if kind == "tcp" and port.isdigit() and int(port) <= 65535:
        return TcpLine(int(port))
    raise UsageError(f"'{spec}' is no way to serve the board; write pty or tcp:PORT, up to 65535")


@contextlib.contextmanager
def _signals() -> Iterator[list[int]]:
    """Signals that ask for the end, collected instead of raised."""
    caught: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    old = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def run_paced(machine: Machine, line: Line, stopped: Callable[[], bool]) -> None:
    """Run the machine at wall-clock pace, moving bytes between its UART and the line, until stopped() holds."""
    begin_wall, begin_ticks = time.monotonic(), machine.now
    while not stopped():
        elapsed = time.monotonic() - begin_wall
        due = begin_ticks + int(elapsed * TICKS_PER_S)
        machine.run_to(min(due, machine.now + int(4 * SLICE_S * TICKS_PER_S)))
        behind_s = (due - machine.now) / TICKS_PER_S
        if behind_s > LAG_S:
            begin_wall += behind_s
        data = line.read()
        if data:
            machine.uart.write(data)
        waiting = machine.uart.in_waiting
        if waiting:
            line.write(machine.uart.read(waiting))
        if behind_s < SLICE_S:
            descriptor = line.watch()
            # Sleep for a slice, or less when the line has something. Not selectors: epoll counts in milliseconds.
            select.select([] if descriptor is None else [descriptor], [], [], SLICE_S)


def serve(
    machine: Machine,
    spec: str,
    *,
    link: Path | None = None,
    couple: Callable[[Machine], None] | None = None,
    announce: Callable[[str], None] = print,
) -> int:
    """Serve the machine's UART on `spec` until SIGINT or SIGTERM; returns that signal's number.

    couple(machine) attaches a plant before time starts: it puts functions of simulated seconds into machine.adc,
    which read machine.pwm. announce gets the address that pyserial can open.
    """
    line = open_line(spec, link)
    try:
        if couple is not None:
            couple(machine)
        with _signals() as caught:
            announce(line.address)
            run_paced(machine, line, lambda: bool(caught))
            return caught[0]
    finally:
        line.close()

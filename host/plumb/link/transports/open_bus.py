"""Open a bus by its name on the command line, as a python-can bus.

    serial:PORT[@BAUD]            a board, real or served, behind a serial port
    tcp:HOST:PORT                 the serial link's text over TCP
    udp:PORT                      the serial link's text in datagrams, on this machine
    can:INTERFACE:CHANNEL[@KBIT]  any interface of python-can; 500 kbit/s by default
    file:PATH                     frames of a log, paced by their time stamps (plumb.link.frame_formats)

`open_bus` opens the host's end; `serve_bus` the far end, where `serial:pty` makes a pseudo-terminal and tcp and udp
wait for a client. plumb.link.endpoint_names parses the names.
"""

from __future__ import annotations

import errno
import logging
import time
from pathlib import Path
from typing import Any

import can

from plumb.errors import LinkError, UsageError
from plumb.files import input_files
from plumb.link.endpoint_names import (
    CanName,
    FileName,
    SerialName,
    SocketcandName,
    TcpName,
    UdpName,
    parse_bus,
    quoted,
    split_rate,
)
from plumb.link.foreign_frames import blocks_in
from plumb.link.frame_formats import table
from plumb.link.frame_records import messages_of
from plumb.link.transports.can_bus import DriverBus
from plumb.link.transports.serial_ports import check_port
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.link.transports.socketcand import SocketcandClient


def open_bus(spec: str, *, listen_only: bool = False) -> can.BusABC:
    """The host's end. listen_only: over SLCAN, make the far end accept no frames from this host.

    Raises UsageError for a name that is not a bus, LinkError when it cannot be opened.
    """
    name = parse_bus(spec)
    if isinstance(name, CanName):
        return open_can(name)
    if isinstance(name, FileName):
        return LogBus(Path(name.path))
    return PlumbBus(name, listen_only=listen_only)


def serve_bus(spec: str, link: Path | None = None) -> can.BusABC:
    """The far end, as a second board on the bus would have it. link: symbolic link to make to the pseudo-terminal.

    Raises UsageError and LinkError as `open_bus`, and UsageError for a link where there is no pseudo-terminal.
    """
    from plumb.link.transports.server_endpoint import NO_TERMINAL, UdpEndpoint, open_endpoint
    from plumb.link.transports.slcan_server import AdapterBus

    name = parse_bus(spec)
    if link is not None and name != SerialName("pty"):
        raise UsageError(NO_TERMINAL)
    match name:
        case SerialName(port="pty"):
            return AdapterBus(open_endpoint("pty", link))
        case TcpName(host, port):
            if host not in ("127.0.0.1", "localhost"):
                raise UsageError(f"{quoted(spec)}: a bus is served on this machine only; write tcp:127.0.0.1:PORT")
            return AdapterBus(open_endpoint(f"tcp:{port}"))
        case UdpName(port):
            return AdapterBus(UdpEndpoint(port))
        case FileName():
            raise UsageError("a file cannot be served as a bus; to write one use `plumb record --bus BUS --out PATH`")
    return open_bus(spec)


def open_can(name: CanName) -> can.BusABC:
    """A bus of python-can. Raises UsageError for an interface that python-can lacks, LinkError for failing to open."""
    if isinstance(name, SocketcandName):
        return SocketcandClient(name.host, name.port, name.channel)
    interface, channel, kbit = name.interface, name.channel, name.kbit
    options: dict[str, Any] = {  # Any: keywords of an interface, which python-can types so
        "interface": interface,
        "channel": channel,
        "bitrate": kbit * 1000,
    }
    if interface == "slcan" and "://" in channel:
        options["sleep_after_open"] = (
            0.0  # python-can waits two seconds by default for adapters that reset when the port is opened
        )
    if interface not in can.VALID_INTERFACES:
        raise UsageError(
            f"python-can has no interface {quoted(interface)}; it has {', '.join(sorted(can.VALID_INTERFACES))}"
        )
    check_port(split_rate(channel)[0] if interface == "slcan" else channel)
    logging.getLogger("can").addHandler(logging.NullHandler())  # the error sentence has what drivers log
    try:
        return DriverBus(name.text, can.Bus(**options))
    except LinkError:
        raise
    except Exception as error:  # interfaces raise any exception of their drivers
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        remedy = _remedy(interface, channel, kbit, getattr(error, "errno", None))
        raise LinkError(f"{name.text} cannot be opened ({reason}): {remedy}") from None


def _remedy(interface: str, channel: str, kbit: int, number: int | None) -> str:
    """Remedy for a CAN interface that does not open. number: of the system's error, where there is one."""
    if interface == "socketcan" and number == errno.EAFNOSUPPORT:
        return (
            "this kernel has no CAN, and no interface can be brought up on it: load its module with `sudo modprobe "
            "can_raw`, or use a kernel that has it (containers use that of their host); an adapter with a serial port "
            "needs none of it: can:slcan:PORT"
        )
    if interface == "socketcan" and number == errno.ENODEV:
        return f"there is no interface {channel}: plug its adapter in; `plumb ports` lists the interfaces"
    if interface == "socketcan":
        return f"bring it up with `sudo ip link set {channel} up type can bitrate {kbit * 1000}`"
    if interface == "slcan":
        return "check that the adapter is plugged in, that its port is right, and that no other program has it open"
    return "check that the interface is up and its driver installed"


class LogBus(can.BusABC):
    """The frames of a log file, paced by their time stamps. Frames sent to it are discarded.

    ended: the last frame has been received.
    """

    def __init__(self, path: Path) -> None:
        self.ended = False
        advice = f"give a log of frames: {table.NAMES}"
        input_files.check_regular(path, advice)
        if not table.may_be(path):
            raise UsageError(f"{path} is no log of frames; {advice}")
        self._blocks = blocks_in(path, advice)
        self._messages = (message for block in self._blocks for message in messages_of(block))
        self._next = next(self._messages, None)
        self._offset = time.monotonic() - (self._next.timestamp if self._next else 0.0)
        self.channel_info = f"the log {path}"
        super().__init__(str(path))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._next
        due_s = float("inf") if message is None else message.timestamp + self._offset - time.monotonic()
        if message is None or (timeout is not None and due_s > timeout):
            self.ended = message is None
            time.sleep(0.0 if timeout is None else timeout)
            return None, False
        time.sleep(max(0.0, due_s))
        self._next = next(self._messages, None)
        return message, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Discard the frame."""

    def shutdown(self) -> None:
        """Close the file."""
        super().shutdown()
        self._messages.close()
        self._blocks.close()

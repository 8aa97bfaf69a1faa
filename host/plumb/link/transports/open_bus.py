"""A bus by its name on the command line, as a python-can bus.

    serial:PORT[@BAUD]            a board, or a served one, behind a serial port
    tcp:HOST:PORT                 the same text over TCP
    udp:PORT                      the same text in datagrams, on this machine
    can:INTERFACE:CHANNEL[@KBIT]  any interface of python-can; 500 kbit/s unless said
    file:PATH                     frames of a log, paced by their time stamps (.asc .blf .csv .log .trc)

`open_bus` opens the host's end; `serve_bus` the far end, where `serial:pty` makes a pseudo-terminal and tcp and udp
wait for a client. plumb.link.endpoint_names parses the names.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
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
    split_rate,
)
from plumb.link.transports.can_bus import DriverBus
from plumb.link.transports.serial_ports import check_port
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.link.transports.socketcand import SocketcandClient

MOST_LOG_BYTES = 64 << 20
"""Of a log of frames, which is read as a whole: a million frames."""


def open_bus(spec: str, *, listen_only: bool = False) -> can.BusABC:
    """The host's end; listen_only: over SLCAN the other end is told to take no frame from here.

    Raises UsageError for a name that is none, LinkError when it cannot be opened.
    """
    name = parse_bus(spec)
    if isinstance(name, CanName):
        return open_can(name)
    if isinstance(name, FileName):
        return LogBus(Path(name.path))
    return PlumbBus(name, listen_only=listen_only)


def serve_bus(spec: str, link: Path | None = None) -> can.BusABC:
    """The far end: what a second board on the bus would be; link names the pseudo-terminal, if it is one.

    Raises UsageError, LinkError as `open_bus`.
    """
    from plumb.link.transports.server_endpoint import UdpEndpoint, open_endpoint
    from plumb.link.transports.slcan_server import AdapterBus

    name = parse_bus(spec)
    match name:
        case SerialName(port="pty"):
            return AdapterBus(open_endpoint("pty", link))
        case TcpName(host, port):
            if host not in ("127.0.0.1", "localhost"):
                raise UsageError(f"'{spec}': this end waits on this machine only; write tcp:127.0.0.1:PORT")
            return AdapterBus(open_endpoint(f"tcp:{port}"))
        case UdpName(port):
            return AdapterBus(UdpEndpoint(port))
        case FileName():
            raise UsageError("a file is no end of a conversation; plumb record BUS --out PATH writes one")
    return open_bus(spec)


def open_can(name: CanName) -> can.BusABC:
    """Any interface of python-can; raises UsageError for one that it does not have, LinkError when it does not open."""
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
            0.0  # two seconds for an adapter that starts when its port is opened: not this one
        )
    if interface not in can.VALID_INTERFACES:
        raise UsageError(f"python-can has no interface '{interface}'; it has {', '.join(sorted(can.VALID_INTERFACES))}")
    check_port(split_rate(channel)[0] if interface == "slcan" else channel)
    logging.getLogger("can").addHandler(logging.NullHandler())  # what drivers log is in the one sentence, too
    try:
        return DriverBus(name.text, can.Bus(**options))
    except LinkError:
        raise
    except Exception as error:  # interfaces raise whatever their drivers do
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise LinkError(f"{name.text} cannot be opened ({reason}): {_remedy(interface, channel, kbit)}") from None


def _remedy(interface: str, channel: str, kbit: int) -> str:
    """What to do about a CAN interface that does not open."""
    if interface == "socketcan":
        return f"bring it up with `sudo ip link set {channel} up type can bitrate {kbit * 1000}`"
    if interface == "slcan":
        return "check the adapter's port, which other program has it, and that the adapter is plugged in"
    return "check that the interface is up and its driver installed"


class LogBus(can.BusABC):
    """The frames of a log file, each when its time has come, then nothing more. What is sent is thrown away.

    ended: the last frame has been given.
    """

    def __init__(self, path: Path) -> None:
        self.ended = False
        input_files.check(path, MOST_LOG_BYTES, "give a log of frames (.asc .blf .csv .log .trc)")
        try:
            self._messages: Iterator[can.Message] = iter(list(can.LogReader(path)))
        except Exception as error:  # readers raise whatever a damaged log leads them to
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise UsageError(f"{path} cannot be read as a log of frames: {reason}") from None
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
        """A log takes nothing."""

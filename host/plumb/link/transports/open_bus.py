"""A bus by its name on the command line, as a python-can bus.

    serial:PORT[@BAUD]            a board, or a served one, behind a serial port
    tcp:HOST:PORT                 the same text over TCP
    udp:PORT                      the same text in datagrams, on this machine
    can:INTERFACE:CHANNEL[@KBIT]  any interface of python-can; 500 kbit/s unless said
    file:PATH                     frames of a log, paced by their time stamps (.asc .blf .csv .log .trc)

`open_bus` takes the host's end; `serve_bus` the far end, where `serial:pty` makes a pseudo-terminal and tcp and udp
wait for whoever opens them.
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
from plumb.link.transports.can_bus import DriverBus
from plumb.link.transports.serial_ports import check_port
from plumb.link.transports.slcan_bus import DEFAULT_BAUDRATE, PlumbBus
from plumb.link.transports.socketcand import SocketcandClient

DEFAULT_KBIT = 500
MOST_LOG_BYTES = 64 << 20
"""Of a log of frames, which is read as a whole: a million frames."""
KINDS = "serial:PORT[@BAUD], tcp:HOST:PORT, udp:PORT, can:INTERFACE:CHANNEL[@KBIT] or file:PATH"


def open_bus(spec: str, *, listen_only: bool = False) -> can.BusABC:
    """The host's end; listen_only: over SLCAN the other end is told to take no frame from here.

    Raises UsageError for a name that is none, LinkError when it cannot be opened.
    """
    kind, address = kind_and_address(spec)
    if kind == "serial":
        return PlumbBus(address, DEFAULT_BAUDRATE, listen_only=listen_only)
    if kind == "tcp":
        return PlumbBus(spec, listen_only=listen_only)
    if kind == "udp":
        return PlumbBus(f"udp:{_port(spec, address)}", listen_only=listen_only)
    if kind == "can":
        return open_can(address)
    return LogBus(Path(address))


def serve_bus(spec: str, link: Path | None = None) -> can.BusABC:
    """The far end: what a second board on the bus would be; link names the pseudo-terminal, if it is one.

    Raises UsageError, LinkError as `open_bus`.
    """
    from plumb.link.transports.server_endpoint import UdpEndpoint, open_endpoint
    from plumb.link.transports.slcan_server import AdapterBus

    kind, address = kind_and_address(spec)
    if spec == "serial:pty":
        return AdapterBus(open_endpoint("pty", link))
    if kind == "tcp":
        host, _, port = address.rpartition(":")
        if host not in ("127.0.0.1", "localhost"):
            raise UsageError(f"'{spec}': this end waits on this machine only; write tcp:127.0.0.1:PORT")
        return AdapterBus(open_endpoint(f"tcp:{port}"))
    if kind == "udp":
        return AdapterBus(UdpEndpoint(_port(spec, address)))
    if kind == "file":
        raise UsageError("a file is no end of a conversation; plumb record BUS --out PATH writes one")
    return open_bus(spec)


def kind_and_address(spec: str) -> tuple[str, str]:
    """The name taken apart; raises UsageError for one that is none."""
    kind, _, address = spec.partition(":")
    if kind not in ("serial", "tcp", "udp", "can", "file") or not address:
        raise UsageError(f"'{spec}' names no bus; use {KINDS}")
    return kind, address


def _port(spec: str, address: str) -> int:
    if not address.isdigit() or int(address) > 65535:
        raise UsageError(f"'{spec}': a port is a number up to 65535")
    return int(address)


def open_can(address: str) -> can.BusABC:
    """INTERFACE:CHANNEL[@KBIT]; of slcan, what follows the @ is the port's baud rate, as python-can has it."""
    interface, _, channel = address.partition(":")
    kbit = DEFAULT_KBIT
    head, _, rate = channel.rpartition("@")
    if interface != "slcan" and head and rate.isdigit():
        channel, kbit = head, int(rate)
    options: dict[str, Any] = {"interface": interface, "channel": channel, "bitrate": kbit * 1000}
    if interface == "socketcand":
        host, _, rest = channel.partition(":")
        port, _, name = rest.partition(":")
        if not host or not port.isdigit() or int(port) > 65535 or not name:
            raise UsageError(f"'can:{address}': write can:socketcand:HOST:PORT:CHANNEL")
        return SocketcandClient(host, int(port), name)
    if interface == "slcan" and "://" in channel:
        options["sleep_after_open"] = (
            0.0  # two seconds for an adapter that starts when its port is opened: not this one
        )
    if not interface or not channel:
        raise UsageError(f"'can:{address}' names no bus; use can:INTERFACE:CHANNEL[@KBIT]")
    if interface not in can.VALID_INTERFACES:
        raise UsageError(f"python-can has no interface '{interface}'; it has {', '.join(sorted(can.VALID_INTERFACES))}")
    check_port(channel.rpartition("@")[0] or channel if interface == "slcan" else channel)
    logging.getLogger("can").addHandler(logging.NullHandler())  # what drivers log is in the one sentence, too
    try:
        return DriverBus(f"can:{address}", can.Bus(**options))
    except LinkError:
        raise
    except Exception as error:  # interfaces raise whatever their drivers do
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise LinkError(f"can:{address} cannot be opened ({reason}): {_remedy(interface, channel, kbit)}") from None


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

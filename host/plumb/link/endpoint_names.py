"""Names of boards, buses and served ports as people write them, parsed into typed values.

    BOARD   native | qemu[:CORE] | virtual | serial:PORT[@BAUD] | can:INTERFACE:CHANNEL[@KBIT] | program:COMMAND
    BUS     serial:PORT[@BAUD] | tcp:HOST:PORT | udp:PORT | can:INTERFACE:CHANNEL[@KBIT] | file:PATH

A served board has its UART at pty or tcp:PORT, and its CAN bus at slcan:pty, slcan:tcp:PORT, socketcand:PORT or
INTERFACE:CHANNEL[@KBIT]. Parsing opens nothing. Text that does not fit the grammar raises UsageError: one sentence that
gives the grammar.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from urllib.parse import urlsplit

from plumb.errors import UsageError
from plumb.near_names import LONGEST, did_you_mean

DEFAULT_BAUD = 921600
DEFAULT_KBIT = 500
LARGEST_RATE = 10**9 - 1
"""Largest baud or bit rate accepted; it fits the integer of every driver."""
LONGEST_ECHO = 80
"""Characters of a wrong name that an error repeats."""
RFC2217_OPTIONS = ("ign_set_control", "poll_modem", "timeout", "logging")
"""Options that pyserial takes behind the `?` of an rfc2217:// address."""

REMOTE_BOARDS = "serial:PORT[@BAUD] or can:INTERFACE:CHANNEL[@KBIT]"
QEMU_CORES = ("m0", "m3", "m4", "m7")
"""Cortex-M0, -M3, -M4 and -M7; `qemu` alone is the M3."""
_QEMU = f"qemu[:{'|'.join(QEMU_CORES)}]"
BOARDS = f"auto, native, {_QEMU}, virtual, {REMOTE_BOARDS}; golden check also takes program:COMMAND"
BUSES = "serial:PORT[@BAUD], tcp:HOST:PORT, udp:PORT, can:INTERFACE:CHANNEL[@KBIT] or file:PATH"


@dataclass(frozen=True)
class LocalBoard:
    """A board that runs in this process or is started by it. kind: fixed, native, qemu or virtual.

    core: of qemu:CORE, "" otherwise.
    """

    kind: str
    core: str = ""


@dataclass(frozen=True)
class SerialName:
    """A serial port. port: a device, socket://HOST:PORT or rfc2217://HOST:PORT; of a served bus also `pty`."""

    port: str
    baud: int = DEFAULT_BAUD


@dataclass(frozen=True)
class TcpName:
    """The serial link's text over TCP."""

    host: str
    port: int


@dataclass(frozen=True)
class UdpName:
    """The serial link's text in UDP datagrams, on this machine."""

    port: int


@dataclass(frozen=True)
class CanName:
    """A bus that python-can opens. text: the whole name as written, with `can:`.

    kbit: bit rate in kbit/s. For `slcan` the channel keeps its @: the number is the baud rate of the adapter's port.
    """

    text: str
    interface: str
    channel: str
    kbit: int = DEFAULT_KBIT


@dataclass(frozen=True)
class SocketcandName(CanName):
    """A bus behind a socketcand server; channel: the server's name for the bus."""

    host: str = ""
    port: int = 0


@dataclass(frozen=True)
class ProgramName:
    """A program of the user's that runs golden vectors. command: its words, the program first."""

    command: tuple[str, ...]


@dataclass(frozen=True)
class FileName:
    """A log of frames."""

    path: str


@dataclass(frozen=True)
class PtyName:
    """A pseudo-terminal that this process makes."""


@dataclass(frozen=True)
class AdapterName:
    """A CAN adapter that this process serves: SLCAN text on a pseudo-terminal or a TCP port."""

    endpoint: PtyName | TcpName


@dataclass(frozen=True)
class SocketcandServerName:
    """A socketcand server in this process; port 0: any free one."""

    port: int


_BARE = {
    r"/dev/\S+|COM\d+(@\d+)?|(socket|rfc2217)://\S+": "serial:",
    r"(tty|cu\.)\w\S*": "serial:/dev/",
    r"tcp:\S+:\d+": "serial:socket://",
    r"(socketcan|slcan|pcan|kvaser|gs_usb|candle|socketcand|virtual):\S+": "can:",
    r"[vs]?l?can\d+(@\d+)?": "can:socketcan:",
}
"""Incomplete name -> the part that is missing before it."""
LOCAL_BOARDS = {kind: LocalBoard(kind) for kind in ("fixed", "native", "qemu", "virtual")} | {
    f"qemu:{core}": LocalBoard("qemu", core) for core in QEMU_CORES
}

BoardName = LocalBoard | SerialName | CanName | ProgramName
BusName = SerialName | TcpName | UdpName | CanName | FileName
CanEndName = AdapterName | SocketcandServerName | CanName


def parse_board(text: str) -> BoardName:
    """The board that `text` names; raises UsageError."""
    if text in LOCAL_BOARDS:
        return LOCAL_BOARDS[text]
    kind, _, address = text.partition(":")
    if kind == "serial" and address:
        return _serial(text, address)
    if kind == "can" and address:
        return parse_can(address)
    if kind == "program":
        return _program(text, address)
    raise UsageError(f"{quoted(text)} is not a board{_meant(text)}; use {BOARDS}")


def _meant(text: str) -> str:
    """` (did you mean ...?)` for a port or a bus without its kind, or a name that was mistyped; else ""."""
    if len(text) > LONGEST:
        return ""
    for form, kind in _BARE.items():
        if re.fullmatch(form, text):
            return f" (did you mean {kind}{text.removeprefix('tcp:')}?)"
    return did_you_mean(text, (*LOCAL_BOARDS, "auto"))


def parse_bus(text: str) -> BusName:
    """The bus that `text` names; raises UsageError."""
    kind, _, address = text.partition(":")
    if kind not in ("serial", "tcp", "udp", "can", "file") or not address:
        raise UsageError(f"{quoted(text)} is not a bus; use {BUSES}")
    if kind == "serial":
        return _serial(text, address)
    if kind == "can":
        return parse_can(address)
    return FileName(address) if kind == "file" else parse_network(text)


def parse_network(text: str) -> TcpName | UdpName:
    """tcp:HOST:PORT or udp:PORT, or pyserial's socket://HOST:PORT."""
    if text.startswith("udp:"):
        port = _port(text.removeprefix("udp:"))
        if port is None:
            raise UsageError(f"{quoted(text)}: a port is a number up to 65535")
        return UdpName(port)
    prefix = "socket://" if text.startswith("socket://") else "tcp:"
    host, _, number = text.removeprefix(prefix).rpartition(":")
    port = _port(number)
    if not host or port is None:
        raise UsageError(f"{quoted(text)} is not an address: write {prefix}HOST:PORT, with a port up to 65535")
    return TcpName(host, port)


def parse_can(address: str) -> CanName:
    """INTERFACE:CHANNEL[@KBIT], without `can:` before it."""
    text = f"can:{address}"
    interface, _, channel = address.partition(":")
    kbit = DEFAULT_KBIT
    port, rate = split_rate(channel)
    if interface != "slcan":
        channel, kbit = port, DEFAULT_KBIT if rate is None else rate
    if interface == "socketcand":
        host, _, rest = channel.partition(":")
        number, _, channel = rest.partition(":")
        server_port = _port(number)
        if not host or server_port is None or not channel:
            raise UsageError(
                f"{quoted(text)} is not a bus; use can:socketcand:HOST:PORT:CHANNEL, with a port up to 65535"
            )
        return SocketcandName(text, interface, channel, kbit, host, server_port)
    if not interface or not channel:
        raise UsageError(f"{quoted(text)} is not a bus; use can:INTERFACE:CHANNEL[@KBIT]")
    return CanName(text, interface, channel, kbit)


def parse_endpoint(text: str) -> PtyName | TcpName:
    """Endpoint at which this process serves a UART: pty or tcp:PORT."""
    if text == "pty":
        return PtyName()
    kind, _, number = text.partition(":")
    port = _port(number)
    if kind == "tcp" and port is not None:
        return TcpName("127.0.0.1", port)
    raise UsageError(f"{quoted(text)} is not an endpoint to serve on; write pty or tcp:PORT, up to 65535")


def parse_can_end(text: str) -> CanEndName:
    """Endpoint at which this process serves a CAN bus, or the bus that it joins; raises UsageError."""
    kind, _, where = text.partition(":")
    if kind == "slcan" and (where == "pty" or where.startswith("tcp:")):
        return AdapterName(parse_endpoint(where))
    port = _port(where)
    if kind == "socketcand" and port is not None:
        return SocketcandServerName(port)
    if not where or kind in ("can", "tcp", "udp", "file"):  # the kinds of --bus, where "can:" comes first
        raise UsageError(
            f"{quoted(text)} is not a CAN bus; write slcan:pty, slcan:tcp:PORT, socketcand:PORT or "
            "INTERFACE:CHANNEL[@KBIT]"
        )
    return parse_can(text)


def split_rate(text: str) -> tuple[str, int | None]:
    """The text before a trailing @RATE, and the rate; the whole text and None without one. Raises UsageError for 0."""
    head, _, digits = text.rpartition("@")
    rate = _number(digits)
    if head and rate == 0:
        raise UsageError(f"{quoted(text)}: a rate is a number above 0; write it, or leave @0 out for the default")
    return (head, rate) if head and rate is not None and rate <= LARGEST_RATE else (text, None)


def _serial(text: str, address: str) -> SerialName:
    port, baud = split_rate(address)
    if baud is None and "@" in address:
        raise UsageError(f"the baud rate in {quoted(text)} is not a number; write serial:PORT@{DEFAULT_BAUD}")
    if port.startswith("socket://"):
        parse_network(port)
    elif port.startswith("rfc2217://"):
        _check_rfc2217(port)
    return SerialName(port, DEFAULT_BAUD if baud is None else baud)


def _program(text: str, command: str) -> ProgramName:
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"{quoted(text)} is no command ({error}); write program:COMMAND as in a shell") from None
    if not words or any("\0" in word for word in words):
        raise UsageError(f"{quoted(text)} names no program; write program:COMMAND")
    return ProgramName(tuple(words))


def _check_rfc2217(address: str) -> None:
    """Raises UsageError unless pyserial can read rfc2217://HOST:PORT[?OPTION[&OPTION...]]."""
    try:
        parts = urlsplit(address)
        complete = bool(parts.hostname) and parts.port is not None and not parts.path
    except ValueError:  # a port out of range, or an unfinished bracket
        complete = False
    if not complete:
        raise UsageError(f"{quoted(address)} is not an address: write rfc2217://HOST:PORT, with a port up to 65535")
    for option in filter(None, parts.query.split("&")):
        if option.partition("=")[0] not in RFC2217_OPTIONS:
            raise UsageError(
                f"{quoted(address)}: '{option[:LONGEST_ECHO]}' is not an option of rfc2217://HOST:PORT; "
                f"it takes {', '.join(RFC2217_OPTIONS)}"
            )


def quoted(text: str) -> str:
    """The text in quotes for an error, cut after LONGEST_ECHO characters."""
    return f"'{text[:LONGEST_ECHO]}...'" if len(text) > LONGEST_ECHO else f"'{text}'"


def _port(digits: str) -> int | None:
    port = _number(digits)
    return port if port is not None and port <= 65535 else None


def _number(digits: str) -> int | None:
    """The value of at most ten ASCII digits; None for other text."""
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 10 else None

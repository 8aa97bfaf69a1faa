"""Names of boards, buses and served ports as people write them, parsed into typed values.

    BOARD   native | qemu | virtual | serial:PORT[@BAUD] | can:INTERFACE:CHANNEL[@KBIT] | program:COMMAND
    BUS     serial:PORT[@BAUD] | tcp:HOST:PORT | udp:PORT | can:INTERFACE:CHANNEL[@KBIT] | file:PATH

A served board has its UART at pty or tcp:PORT, and its CAN bus at slcan:pty, slcan:tcp:PORT, socketcand:PORT or
INTERFACE:CHANNEL[@KBIT]. Parsing opens nothing. Text that does not fit the grammar raises UsageError: one sentence that
gives the grammar.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass

from plumb.errors import UsageError

DEFAULT_BAUD = 921600
DEFAULT_KBIT = 500
LARGEST_RATE = 10**9 - 1
"""Of a baud or bit rate; nothing is this fast, and every driver's integer holds it."""

REMOTE_BOARDS = "serial:PORT[@BAUD] or can:INTERFACE:CHANNEL[@KBIT]"
BOARDS = f"native, qemu, virtual, {REMOTE_BOARDS}; golden check also takes program:COMMAND"
BUSES = "serial:PORT[@BAUD], tcp:HOST:PORT, udp:PORT, can:INTERFACE:CHANNEL[@KBIT] or file:PATH"


@dataclass(frozen=True)
class LocalBoard:
    """A board that runs in this process or is started by it. kind: fixed, native, qemu or virtual."""

    kind: str


@dataclass(frozen=True)
class SerialName:
    """A serial port. port: a device, socket://HOST:PORT or rfc2217://HOST:PORT; of a served bus also `pty`."""

    port: str
    baud: int = DEFAULT_BAUD


@dataclass(frozen=True)
class TcpName:
    """The text of the serial link over TCP."""

    host: str
    port: int


@dataclass(frozen=True)
class UdpName:
    """The text of the serial link in datagrams, on this machine."""

    port: int


@dataclass(frozen=True)
class CanName:
    """A bus that python-can opens. text: the whole name as written, with `can:`.

    kbit: bit rate in kbit/s. For `slcan`, an @ belongs to the channel: it is the baud rate of the adapter's port.
    """

    text: str
    interface: str
    channel: str
    kbit: int = DEFAULT_KBIT


@dataclass(frozen=True)
class SocketcandName(CanName):
    """A bus behind a socketcand server; channel: what the server calls it."""

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


LOCAL_BOARDS = {kind: LocalBoard(kind) for kind in ("fixed", "native", "qemu", "virtual")}

BoardName = LocalBoard | SerialName | CanName | ProgramName
BusName = SerialName | TcpName | UdpName | CanName | FileName
CanEndName = AdapterName | SocketcandServerName | CanName


def parse_board(text: str) -> BoardName:
    """The board that `text` names."""
    if text in LOCAL_BOARDS:
        return LOCAL_BOARDS[text]
    kind, _, address = text.partition(":")
    if kind == "serial" and address:
        return _serial(text, address)
    if kind == "can" and address:
        return parse_can(address)
    if kind == "program":
        return _program(text, address)
    raise UsageError(f"'{text}' names no board; use {BOARDS}")


def parse_bus(text: str) -> BusName:
    """The bus that `text` names."""
    kind, _, address = text.partition(":")
    if kind not in ("serial", "tcp", "udp", "can", "file") or not address:
        raise UsageError(f"'{text}' names no bus; use {BUSES}")
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
            raise UsageError(f"'{text}': a port is a number up to 65535")
        return UdpName(port)
    prefix = "socket://" if text.startswith("socket://") else "tcp:"
    host, _, number = text.removeprefix(prefix).rpartition(":")
    port = _port(number)
    if not host or port is None:
        raise UsageError(f"'{text}' is no address: write {prefix}HOST:PORT")
    return TcpName(host, port)


def parse_can(address: str) -> CanName:
    """INTERFACE:CHANNEL[@KBIT], without `can:` before it."""
    text = f"can:{address}"
    interface, _, channel = address.partition(":")
    kbit = DEFAULT_KBIT
    if interface != "slcan":
        channel, rate = split_rate(channel)
        kbit = DEFAULT_KBIT if rate is None else rate
    if interface == "socketcand":
        host, _, rest = channel.partition(":")
        number, _, channel = rest.partition(":")
        port = _port(number)
        if not host or port is None or not channel:
            raise UsageError(f"'{text}': write can:socketcand:HOST:PORT:CHANNEL")
        return SocketcandName(text, interface, channel, kbit, host, port)
    if not interface or not channel:
        raise UsageError(f"'{text}' names no bus; use can:INTERFACE:CHANNEL[@KBIT]")
    return CanName(text, interface, channel, kbit)


def parse_endpoint(text: str) -> PtyName | TcpName:
    """Where this process serves a UART: pty or tcp:PORT."""
    if text == "pty":
        return PtyName()
    kind, _, number = text.partition(":")
    port = _port(number)
    if kind == "tcp" and port is not None:
        return TcpName("127.0.0.1", port)
    raise UsageError(f"'{text}' is not an endpoint to serve on; write pty or tcp:PORT, up to 65535")


def parse_can_end(text: str) -> CanEndName:
    """Where this process joins or serves a CAN bus."""
    kind, _, where = text.partition(":")
    if kind == "slcan" and (where == "pty" or where.startswith("tcp:")):
        return AdapterName(parse_endpoint(where))
    port = _port(where)
    if kind == "socketcand" and port is not None:
        return SocketcandServerName(port)
    return parse_can(text)


def split_rate(text: str) -> tuple[str, int | None]:
    """The text before a trailing @RATE, and the rate; the whole text and None where there is no such thing."""
    head, _, digits = text.rpartition("@")
    rate = _number(digits)
    return (head, rate) if head and rate is not None and rate <= LARGEST_RATE else (text, None)


def _serial(text: str, address: str) -> SerialName:
    port, baud = split_rate(address)
    if baud is None and "@" in address:
        raise UsageError(f"the baud rate in '{text}' is not a number; write serial:PORT@{DEFAULT_BAUD}")
    return SerialName(port, DEFAULT_BAUD if baud is None else baud)


def _program(text: str, command: str) -> ProgramName:
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"'{text}' is no command ({error}); write program:COMMAND as in a shell") from None
    if not words or any("\0" in word for word in words):
        raise UsageError(f"'{text}' names no program; write program:COMMAND")
    return ProgramName(tuple(words))


def _port(digits: str) -> int | None:
    port = _number(digits)
    return port if port is not None and port <= 65535 else None


def _number(digits: str) -> int | None:
    """A number in ASCII digits, none of more than ten."""
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 10 else None

"""Find the boards of this machine: adapters on serial ports, boards that other processes serve, and a CAN bus that the
settings name.

A served board says where it is. A serial port is opened and asked only when a caller wants that: opening a port resets
some boards, and disarms a board that a host armed. Ports whose adapter plumb does not know, such as a printer's, are
never opened unless they are named; nor is a CAN bus asked that the settings do not name, since a frame at a wrong bit
rate disturbs everybody there.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from plumb.errors import LinkError, PlumbError
from plumb.files import settings
from plumb.link.endpoint_names import CanName, SerialName, parse_board
from plumb.link.identity import Identity
from plumb.link.served_boards import served_boards
from plumb.link.usb_adapters import UsbAdapter, known

AUTO = "auto"


@dataclass(frozen=True)
class SerialPort:
    """A serial port. usb: vendor, product and serial number as text, "" for a port that is not on USB."""

    device: str
    description: str
    usb: str
    adapter: UsbAdapter | None

    @property
    def may_have_board(self) -> bool:
        return self.adapter is not None and self.adapter.kind == "uart"

    @property
    def name(self) -> str:
        """The port as --board or BUS takes it."""
        slcan = self.adapter is not None and self.adapter.kind == "slcan"
        return f"can:slcan:{self.device}" if slcan else f"serial:{self.device}"


@dataclass(frozen=True)
class Candidate:
    """A place where a board may be. about: what is there, in a few words. certain: a process says that it serves a
    board there."""

    name: str
    about: str
    certain: bool = False


@dataclass(frozen=True)
class Answer:
    """Result of a request to a candidate: the board's identity, or why there is none."""

    candidate: Candidate
    identity: Identity | None = None
    trouble: str = ""

    @property
    def is_board(self) -> bool:
        return self.candidate.certain or self.identity is not None


def serial_ports() -> list[SerialPort]:
    """The serial ports of this machine, by name."""
    from serial.tools import list_ports

    return [
        SerialPort(
            port.device,
            port.description if port.description not in (None, "n/a") else "",
            "" if port.vid is None else f"{port.vid:04x}:{port.pid:04x} {port.serial_number or ''}".rstrip(),
            known(port.vid, port.pid),
        )
        for port in sorted(list_ports.comports(), key=lambda entry: entry.device)
    ]


def candidates() -> list[Candidate]:
    """Candidates of `--board auto`: served boards, serial ports with an adapter that plumb knows, the setting `can`."""
    found = [Candidate(board.names[0], served_text(board.system), True) for board in served_boards()]
    for port in serial_ports():
        if port.adapter is not None and port.may_have_board:
            found.append(Candidate(port.name, port.adapter.name))
    bus = settings.read().get("can")
    return [*found, Candidate(bus, "setting can")] if bus else found


def served_text(system: str) -> str:
    return f"virtual board, {system}" if system else "virtual board"


def ask(candidate: Candidate) -> Answer:
    """Open the candidate and read the identity of a board there."""
    from plumb.link.session import Session
    from plumb.link.transports.open_bus import open_can

    try:
        name = parse_board(candidate.name)
        assert isinstance(name, CanName | SerialName)
        with Session.over(open_can(name)) if isinstance(name, CanName) else Session.open(name) as session:
            return Answer(candidate, session.identity)
    except PlumbError as error:
        return Answer(candidate, None, str(error))


def ask_all(asked: list[Candidate]) -> list[Answer]:
    """Ask those candidates that may have no board, all at once."""
    with ThreadPoolExecutor(max_workers=8) as pool:
        return list(pool.map(lambda one: Answer(one) if one.certain else ask(one), asked))


def only_board() -> Candidate:
    """The one board of this machine, for `--board auto`. A single candidate is not opened here; the
    caller opens it.

    Raises LinkError with the list unless there is exactly one."""
    found = candidates()
    if not found:
        raise LinkError(
            "no board is here: no process serves one, and no port has an adapter that plumb knows; plug one in, or "
            "name the board (`plumb ports` lists what is there)"
        )
    if len(found) == 1:
        return found[0]
    answers = ask_all(found)
    boards = [answer.candidate for answer in answers if answer.is_board]
    if len(boards) == 1:
        return boards[0]
    if boards:
        raise LinkError(f"{len(boards)} boards are here: {_listed(boards)}; name one of them with --board")
    reasons = "; ".join(f"{answer.candidate.name}: {answer.trouble}" for answer in answers)
    raise LinkError(f"none of {len(found)} ports answers as a board ({reasons}): `plumb doctor --board NAME` says why")


def _listed(boards: list[Candidate]) -> str:
    return ", ".join(f"{board.name} ({board.about})" for board in boards)


def only_port() -> str:
    """The one serial port with an adapter that plumb knows, for `--port auto`. Raises LinkError with the list unless
    there is exactly one."""
    ports = [port for port in serial_ports() if port.may_have_board]
    if len(ports) == 1:
        return ports[0].device
    if not ports:
        raise LinkError("no port has an adapter that plumb knows: plug one in, or name the port (`plumb ports`)")
    listed = ", ".join(f"{port.device} ({port.description})" for port in ports)
    raise LinkError(f"{len(ports)} adapters are here: {listed}; name one of them with --port")


def resolved(name: str) -> str:
    """The board's own name where `name` is auto, else the name itself. Raises LinkError as `only_board`."""
    return only_board().name if name == AUTO else name

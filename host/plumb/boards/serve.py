"""A simulated board as a process of its own: its UART on a pseudo-terminal or a TCP port, its CAN bus coupled with any
python-can bus, in real time, or as slowly as a client that asks it to wait (`client_time`). The UART has one client at
a time; the board keeps running while clients come and go. Bytes that the board sends while no client is connected are
lost, as on a cable."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import can

from plumb.boards.client_time import ClientTime
from plumb.boards.debugging import wall_s, while_standing
from plumb.boards.flash_file import KeptSlots
from plumb.errors import LinkError
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.link.endpoint_names import DEFAULT_KBIT, CanName, SocketcandServerName, parse_can_end
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.transports.server_endpoint import ServerEndpoint, open_endpoint, wait_readable
from plumb.link.transports.waiting_board import STANDS

SLICE_S = 0.0003
"""Pause between two turns of the serving loop: the resolution of real time."""
LAG_S = 0.05
"""When the simulation lags by more than this behind the wall clock, it does not catch up."""


class UartEnd(Protocol):
    """The host's end of a board's UART."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int, /) -> bytes: ...
    def write(self, data: bytes, /) -> int: ...


class Served(Protocol):
    """A board whose simulated time, in ticks, passes only in run_to()."""

    @property
    def uart(self) -> UartEnd: ...
    @property
    def now(self) -> int: ...
    def run_to(self, ticks: int, /) -> None: ...


class Joined(Protocol):
    """A coupling of a board's CAN bus with another bus."""

    def move(self) -> None: ...


class Orders(Protocol):
    """Orders for a hand that holds the board's body."""

    def look(self) -> None: ...


class Trace(Protocol):
    """A recording of the board's pins."""

    def flush(self) -> None: ...


@dataclass(frozen=True)
class Radio:
    """The line of a board's radio receiver. spec: where it is served; receive: takes its bytes."""

    spec: str
    receive: Callable[[bytes], object]


Join = Callable[[can.BusABC, int], Joined]
"""Couples a board's CAN bus with another bus, at this bit rate in kbit/s."""


def run_paced(
    machine: Served,
    line: ServerEndpoint,
    stopped: Callable[[], bool],
    joint: Joined | None = None,
    kept: KeptSlots | None = None,
    say: Callable[[str], None] = lambda text: None,
    trace: Trace | None = None,
    orders: Orders | None = None,
    sticks: tuple[ServerEndpoint, Callable[[bytes], object]] | None = None,
    set_up: Callable[[], object] | None = None,
) -> None:
    """Run the board in real time, or as slowly as a client that it waits for, until stopped() is true; bytes pass
    between its UART and `line`, frames through `joint`, and bytes of the endpoint of `sticks` to what takes them. trace
    is flushed, and orders are looked at, as time passes. say: called with a sentence when the board falls behind real
    time, and when it keeps up again. set_up: sets its plant up anew when the client asks for it."""
    client = ClientTime(set_up)
    while_standing(lambda: line.write(STANDS) if client.waits else None)
    begin_wall, begin_ticks = wall_s(), machine.now
    started_s = begin_wall
    watch = RealTimeWatch("the virtual board", "this machine is too slow or too busy for it", say, wall_s)
    while not stopped():
        now_s = wall_s()
        watch.note((machine.now - begin_ticks) / TICKS_PER_S, now_s - started_s)
        elapsed = now_s - begin_wall
        due = begin_ticks + int(elapsed * TICKS_PER_S)
        allowed = client.limit(due)
        machine.run_to(max(machine.now, min(allowed, machine.now + int(4 * SLICE_S * TICKS_PER_S))))
        behind_s = (due - machine.now) / TICKS_PER_S
        if behind_s > LAG_S:
            begin_wall += behind_s
        data = line.read()
        if data := client.received(data, machine.now):
            machine.uart.write(data)
        if client.waits and not line.connected:
            client.gone()
        if sticks is not None and (received := sticks[0].read()):
            sticks[1](received)
        waiting = machine.uart.in_waiting
        sent = (machine.uart.read(waiting) if waiting else b"") + client.mark(machine.now)
        if sent:
            line.write(sent)
        if joint is not None:
            joint.move()
        if kept is not None:
            kept.look()
        if trace is not None:
            trace.flush()
        if orders is not None:
            orders.look()
        if (allowed - machine.now) / TICKS_PER_S < SLICE_S:
            wait_readable(line.watch(), SLICE_S)  # not `selectors`: epoll counts in milliseconds
    if kept is not None:
        kept.write()


def open_can_end(spec: str) -> can.BusABC:
    """The bus to couple the board's CAN bus with: slcan:pty and slcan:tcp:PORT serve a CAN adapter, socketcand:PORT
    serves socketcand, INTERFACE:CHANNEL[@KBIT] is any python-can bus. Raises UsageError, LinkError."""
    from plumb.link.transports.open_bus import open_can
    from plumb.link.transports.slcan_server import AdapterBus
    from plumb.link.transports.socketcand_server import SocketcandBus

    name = parse_can_end(spec)
    if isinstance(name, CanName):
        return open_can(name)
    return (
        SocketcandBus(name.port) if isinstance(name, SocketcandServerName) else AdapterBus(open_endpoint(name.endpoint))
    )


def address_of(bus: can.BusABC, spec: str) -> str:
    """The board name by which a host reaches the board over this bus."""
    from plumb.link.transports.slcan_server import AdapterBus
    from plumb.link.transports.socketcand_server import SocketcandBus

    if isinstance(bus, AdapterBus):
        return f"can:slcan:{bus.address}"
    if isinstance(bus, SocketcandBus):
        return f"can:socketcand:{bus.address}:can0"
    return f"can:{spec}"


@contextlib.contextmanager
def joined(join: Join | None, spec: str | None, announce: Callable[[str], None]) -> Iterator[Joined | None]:
    """Couple the board's CAN bus with the bus that `open_can_end` opens for spec; closes it at the end."""
    if spec is None or join is None:
        yield None
        return
    with open_can_end(spec) as bus:
        try:
            announce(address_of(bus, spec))
            yield join(bus, kbit_of(spec))
        except (can.CanError, OSError) as error:
            raise LinkError(f"the CAN bus {spec} failed ({error}): check the interface, then start again") from None


def kbit_of(spec: str) -> int:
    """Bit rate of the bus that spec names, in kbit/s; DEFAULT_KBIT for a served one."""
    name = parse_can_end(spec)
    return name.kbit if isinstance(name, CanName) else DEFAULT_KBIT


def serve(
    machine: Served,
    spec: str,
    stopped: Callable[[], bool],
    *,
    join: Join | None = None,
    link: Path | None = None,
    can_spec: str | None = None,
    kept: KeptSlots | None = None,
    announce: Callable[[str], None] = print,
    say: Callable[[str], None] = lambda text: None,
    trace: Trace | None = None,
    orders: Orders | None = None,
    radio: Radio | None = None,
    announce_radio: Callable[[str], None] = print,
    set_up: Callable[[], object] | None = None,
) -> None:
    """Serve the board's UART on `spec`, its CAN bus, coupled by join(), on `can_spec`, and the line of its receiver as
    radio says, until stopped() is true.

    announce is called with the address of each, as a board's name without `serial:`, and announce_radio with that of
    the receiver's line; say, trace, orders and set_up as in `run_paced`.
    """
    with contextlib.ExitStack() as stack:
        line = open_endpoint(spec, link)
        stack.callback(line.close)
        sticks = None
        if radio is not None:
            sticks = open_endpoint(radio.spec), radio.receive
            stack.callback(sticks[0].close)
            announce_radio(sticks[0].address)
        joint = stack.enter_context(joined(join, can_spec, announce))
        announce(line.address)
        run_paced(machine, line, stopped, joint, kept, say, trace, orders, sticks, set_up)

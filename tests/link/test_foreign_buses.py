"""python-can's own interfaces, and peers that are none: trouble is one sentence, and nothing waits without end."""

from __future__ import annotations

import errno
import re
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import can
import pytest

from plumb.errors import LinkError, UsageError
from plumb.link.session import Session
from plumb.link.transports.can_bus import MALFORMED_IN_A_ROW, AnyBus, DriverBus
from plumb.link.transports.open_bus import open_bus
from plumb.link.transports.server_endpoint import TcpEndpoint
from plumb.link.transports.socketcand import SocketcandClient
from plumb.link.transports.socketcand_server import MOST_CLIENTS, SocketcandBus
from plumb.spec.protocol import protocol

ANGLE = protocol()["QUAD_ANGLE"]
try:
    socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    KERNEL_HAS_CAN = True
except (AttributeError, OSError):
    KERNEL_HAS_CAN = False
WAIT_S = 120.0
"""For what comes at once: a test that hangs ends, and says where."""
GOOD = can.Message(arbitration_id=ANGLE.identifier, data=ANGLE.pack(0, 0, 1, 2), is_extended_id=False)


class Driver(can.BusABC):
    """An interface that does what a test says: messages, or what it raises instead."""

    def __init__(self, *script: can.Message | Exception | None) -> None:
        self.script = deque(script)
        self.closed = 0
        super().__init__("driver")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        said = self.script.popleft() if self.script else None
        if isinstance(said, Exception):
            raise said
        return said, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise RuntimeError("the driver's own trouble,\nin two lines")

    def shutdown(self) -> None:
        super().shutdown()
        self.closed += 1
        raise can.CanOperationError("it is gone already")


def test_a_malformed_line_costs_that_line_and_is_counted() -> None:
    """What python-can's slcan raises for one."""
    bus = DriverBus("can:x:0", Driver(ValueError("int()"), IndexError("string"), GOOD, ValueError("int()"), GOOD))
    link = AnyBus(bus)
    frames = []
    for _ in range(6):
        frames += link.read_frames(0.0)
    assert frames == [(ANGLE.identifier, bytes(GOOD.data))] * 2
    assert link.rejected == 3
    bus.shutdown()


def test_nothing_but_malformed_lines_is_another_kind_of_line() -> None:
    bus = DriverBus("can:x:0", Driver(*[ValueError("int()")] * MALFORMED_IN_A_ROW))
    with pytest.raises(LinkError, match="can:x:0 failed"):
        for _ in range(MALFORMED_IN_A_ROW):
            bus.recv(0.0)
    bus.shutdown()


@pytest.mark.parametrize("trouble", [RuntimeError("usb"), can.CanOperationError("off"), OSError(19, "no device")])
def test_whatever_a_driver_raises_is_one_sentence(trouble: Exception) -> None:
    driver = Driver(trouble)
    bus = DriverBus("can:x:0", driver)
    with pytest.raises(LinkError, match="check the interface") as caught:
        bus.recv(0.0)
    assert isinstance(caught.value, can.CanError) and "\n" not in str(caught.value)
    with pytest.raises(LinkError, match="the driver's own trouble,") as caught:
        bus.send(GOOD)
    assert "\n" not in str(caught.value)
    bus.shutdown()
    bus.shutdown()
    assert driver.closed == 1


class FullDriver(Driver):
    """A network interface whose queue has no room for so many attempts."""

    def __init__(self, full_for: int) -> None:
        super().__init__()
        self.full_for, self.sent = full_for, 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.full_for:
            self.full_for -= 1
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        self.sent += 1


def test_a_full_queue_is_waited_for() -> None:
    """What socketcan says of the eleventh frame of a burst, with the queue that Linux has by default."""
    driver = FullDriver(full_for=5)
    bus = DriverBus("can:x:0", driver)
    AnyBus(bus).write_frames([(GOOD.arbitration_id, bytes(GOOD.data))] * 3)
    assert (driver.full_for, driver.sent) == (0, 3)
    driver.full_for = 1_000_000
    with pytest.raises(LinkError, match="No buffer space"):
        bus.send(GOOD, timeout=0.01)
    assert driver.sent == 3
    bus.shutdown()


@pytest.mark.parametrize(
    ("spec", "remedy"),
    [
        (
            "can:socketcan:nothere@250",
            "ip link set nothere up type can bitrate 250000" if KERNEL_HAS_CAN else "this kernel has no CAN",
        ),
        ("can:slcan:/nothere", "check that the adapter is plugged in"),
    ],
)
def test_a_missing_interface_gets_a_remedy(spec: str, remedy: str) -> None:
    with pytest.raises(LinkError, match=re.escape(remedy)):
        open_bus(spec)


def test_what_a_driver_logs_is_no_second_line() -> None:
    """The one for Kvaser's adapters logs that their library is not there; pytest would take the log, so a process."""
    command = [sys.executable, "-m", "plumb", "monitor", "--board", "can:kvaser:0", "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 3 and len(done.stderr.splitlines()) == 1, done.stderr


Handler = Callable[[socket.socket], None]


@contextmanager
def peer(handler: Handler) -> Iterator[str]:
    """HOST:PORT of something that a client may take for a board."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(WAIT_S)
    clients = []

    def serve() -> None:
        client, _ = server.accept()
        clients.append(client)
        with client, suppress(OSError):
            handler(client)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"127.0.0.1:{server.getsockname()[1]}"
    finally:
        thread.join()
        server.close()


def until_closed(client: socket.socket) -> None:
    while client.recv(4096):
        pass


def web_server(client: socket.socket) -> None:
    client.recv(1)
    client.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n<html>\r\n")


def noise(client: socket.socket) -> None:
    client.sendall(bytes(range(256)) * 16)
    until_closed(client)


def hangs_up(client: socket.socket) -> None:
    client.close()


@pytest.mark.parametrize("handler", [until_closed, web_server, noise, hangs_up])
def test_a_peer_that_is_no_socketcand_is_link_trouble(handler: Handler, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plumb.link.transports.socketcand._GREETING_S", 0.2)
    with peer(handler) as address, pytest.raises(LinkError) as caught:
        open_bus(f"can:socketcand:{address}:can0")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("handler", [until_closed, noise])
def test_a_peer_that_is_no_board_is_link_trouble(handler: Handler, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plumb.link.board_frames.REPLY_TIMEOUT_S", 0.02)
    monkeypatch.setattr("plumb.link.parameter_transfer.REPLY_TIMEOUT_S", 0.02)
    with peer(handler) as address, pytest.raises(LinkError, match="does not answer"):
        Session.over(open_bus(f"tcp:{address}"))


@contextmanager
def served() -> Iterator[tuple[SocketcandBus, list[can.Message]]]:
    """A socketcand server with somebody who reads it."""
    bus = SocketcandBus(0)
    received: list[can.Message] = []
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            message = bus.recv(0.005)
            if message is not None:
                received.append(message)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield bus, received
    finally:
        stop.set()
        thread.join()
        bus.shutdown()


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def stock(address: str) -> can.BusABC:
    host, port = address.split(":")
    return can.Bus(interface="socketcand", host=host, port=int(port), channel="can0")


def ours(address: str) -> can.BusABC:
    return open_bus(f"can:socketcand:{address}:can0")


@pytest.mark.parametrize("opened", [stock, ours])
def test_frames_go_both_ways_over_socketcand(opened: Callable[[str], can.BusABC]) -> None:
    """python-can's own client and the one that stands in for it."""
    other = can.Message(arbitration_id=0x18FF50E5, data=b"\x01\x02", is_extended_id=True)
    with served() as (bus, received), opened(bus.address) as near:
        for message in (GOOD, other):
            near.send(message)
        wait_for(lambda: len(received) == 2)
        for message in (GOOD, other):
            bus.send(message)
        back = [near.recv(WAIT_S) for _ in range(2)]
    for said in (received, back):
        assert [(m.arbitration_id, m.is_extended_id, bytes(m.data)) for m in said if m is not None] == [
            (m.arbitration_id, m.is_extended_id, bytes(m.data)) for m in (GOOD, other)
        ]


def test_a_socketcand_serves_several_clients_as_a_wire_does() -> None:
    """What one sends, the board and the other clients receive, and not the sender; the board's frames come to all; one
    that does not read, or leaves, holds up nobody."""
    telemetry = can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=False)
    with served() as (bus, received), ours(bus.address) as near, stock(bus.address) as logger:
        host, port = bus.address.split(":")
        with socket.create_connection((host, int(port))) as deaf:
            deaf.sendall(
                b"< open can0 >< rawmode >< echo >< nonsense >< send 123 8 1 >< send 123 9 0 0 0 0 0 0 0 0 0 >"
            )
            wait_for(lambda: bus.raw_clients == 3)
            near.send(GOOD)
            wait_for(lambda: len(received) == 1)
            for _ in range(3000):
                bus.send(telemetry)
            said = deaf.recv(1000)
            assert said.startswith(b"< hi >< ok >< ok >< echo >" + 3 * b"< error unknown command >")
        first = logger.recv(WAIT_S)
        assert first is not None and (first.arbitration_id, bytes(first.data)) == (
            GOOD.arbitration_id,
            bytes(GOOD.data),
        )
        wait_for(lambda: bus.raw_clients == 2)
        for listener in (logger, near):
            message = listener.recv(WAIT_S)
            assert message is not None and message.arbitration_id == 0x100


def test_more_clients_than_a_socketcand_takes_are_turned_away() -> None:
    with served() as (bus, _), ExitStack() as open_ones:
        for _ in range(MOST_CLIENTS):
            open_ones.enter_context(ours(bus.address))
        with pytest.raises(LinkError):
            ours(bus.address)


def test_a_socketcand_that_goes_away_is_noticed() -> None:
    """python-can's own client takes that for a quiet bus."""
    with served() as (bus, _):
        near = ours(bus.address)
    with pytest.raises(LinkError, match="closed the connection"):
        near.recv(WAIT_S)
    near.shutdown()


def test_text_that_is_no_frame_is_let_by_and_counted() -> None:
    def talk(client: socket.socket) -> None:
        client.sendall(b"< hi >")
        for answer in (b"< ok >", b"< ok >< frame"):
            client.recv(100)
            client.sendall(answer)
        client.sendall(b" 7FF 1.5 0102 >< frame XYZ 0 00 >< frame 123 0.0  >< frame 123 0.0 GG >< error 1 2 ><>")
        client.sendall(b"x" * 10_000 + b"< frame 124 0.0 AA >")
        until_closed(client)

    with peer(talk) as address, ours(address) as bus:
        received = [bus.recv(WAIT_S) for _ in range(3)]
        assert isinstance(bus, SocketcandClient) and bus.malformed >= 3
    assert [(m.arbitration_id, bytes(m.data)) for m in received if m] == [
        (0x7FF, b"\1\2"),
        (0x123, b""),
        (0x124, b"\xaa"),
    ]


def test_a_second_client_is_turned_away_at_once_and_the_first_stays() -> None:
    line = TcpEndpoint(0)
    address = line.address.removeprefix("socket://")
    received: list[bytes] = []

    def served() -> bool:
        received.append(line.read())
        return line.connected

    with open_bus(f"tcp:{address}") as first:
        wait_for(served)
        with open_bus(f"tcp:{address}") as second, pytest.raises(LinkError, match="close the other program"):
            for _ in range(1000):
                served()
                second.recv(0.005)
        line.write(b"t3048" + bytes(GOOD.data).hex().upper().encode() + b"\r")
        answer = first.recv(WAIT_S)
    assert answer is not None and bytes(answer.data) == bytes(GOOD.data)
    # What the first says when it opens, the order to wait for it among it, and nothing of what the second said.
    assert b"".join(received) == b"\rC\rO\rWAIT\r"
    line.close()


@pytest.mark.parametrize("spec", ["can:socketcand::4000:can0", "can:socketcand:host:port:can0", "can:socketcand:h:1"])
def test_an_incomplete_socketcand_address_is_wrong_use(spec: str) -> None:
    with pytest.raises(UsageError, match="HOST:PORT:CHANNEL"):
        open_bus(spec)

"""A bus by its name: both ends of a cable, stock tools at one of them, and one sentence for what is no bus."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import pytest
import serial

from plumb.errors import LinkError, PlumbError, UsageError
from plumb.link.transports.open_bus import LogBus, open_bus, serve_bus
from plumb.link.transports.server_endpoint import BACKLOG_BYTES, PtyEndpoint, ServerEndpoint, TcpEndpoint, open_endpoint
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.link.transports.slcan_server import AdapterBus
from plumb.spec.protocol import protocol

ANGLE = protocol()["QUAD_ANGLE"]
WAIT_S = 60.0
"""For what comes at once, on a machine that may have other things to do."""


def frame(step: int) -> can.Message:
    return can.Message(
        arbitration_id=ANGLE.identifier, data=ANGLE.pack(step & 15, 0, step, -step), is_extended_id=False
    )


@contextmanager
def answering(bus: can.BusABC) -> Iterator[list[can.Message]]:
    """The bus served by a thread, as a process of its own would: its received frames are kept."""
    received: list[can.Message] = []
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            message = bus.recv(0.01)
            if message is not None:
                received.append(message)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield received
    finally:
        done.set()
        thread.join()


def wait_for(condition: object, seconds: float = WAIT_S) -> None:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:  # type: ignore[operator]
        time.sleep(0.005)
    assert condition()  # type: ignore[operator]


def address_of(far: AdapterBus) -> str:
    text = far.channel_info.removeprefix("SLCAN on ")
    return text.replace("socket://", "tcp:") if ":" in text else f"serial:{text}"


@pytest.mark.parametrize("spec", ["serial:pty", "tcp:127.0.0.1:0", "udp:0"])
def test_frames_go_both_ways_between_the_two_ends(spec: str) -> None:
    far = serve_bus(spec)
    assert isinstance(far, AdapterBus)
    with answering(far) as received, open_bus(address_of(far)) as near:
        wait_for(lambda: far.open)
        for step in range(40):
            near.send(frame(step))
        wait_for(lambda: len(received) == 40)
        assert [bytes(m.data) for m in received] == [bytes(frame(step).data) for step in range(40)]
        for step in range(40):
            far.send(frame(step))
        back = [near.recv(WAIT_S) for _ in range(40)]
        assert [bytes(m.data) for m in back if m] == [bytes(frame(step).data) for step in range(40)]
    far.shutdown()


def test_nothing_is_sent_before_a_host_opens_the_link_nor_after_it_left() -> None:
    far = serve_bus("tcp:127.0.0.1:0")
    far.send(frame(1))
    with answering(far):
        with open_bus(address_of(far)) as near:  # type: ignore[arg-type]
            wait_for(lambda: far.open)  # type: ignore[attr-defined]
            assert near.recv(0.1) is None
        wait_for(lambda: not far.open)  # type: ignore[attr-defined]
        far.send(frame(2))
        with open_bus(address_of(far)) as near:  # type: ignore[arg-type]
            wait_for(lambda: far.open)  # type: ignore[attr-defined]
            assert near.recv(0.1) is None
    far.shutdown()


def test_an_adapter_answers_the_commands_that_stock_tools_send() -> None:
    far = AdapterBus(open_endpoint("pty"))
    transcript = [
        (b"\r", b"\r"),
        (b"S6\r", b"\r"),
        (b"t1000\r", b"\a"),  # not open yet
        (b"V\r", b"V0101\r"),
        (b"O\r", b"\r"),
        (b"O\r", b"\r"),
        (b"t1002AB0\r", b"\a"),
        (b"t1002AB01\r", b"\r"),
        (b"X\r", b"\a"),
        (b"L\r", b"\r"),
        (b"t1002AB01\r\r", b"\a\r"),
        (b"C\r", b"\r"),
    ]
    with answering(far) as received, serial.Serial(address_of(far).removeprefix("serial:"), timeout=WAIT_S) as port:
        for question, answer in transcript:
            port.write(question)
            assert port.read(len(answer)) == answer
    assert [(m.arbitration_id, bytes(m.data)) for m in received] == [(0x100, b"\xab\x01")]
    far.shutdown()


def test_python_cans_own_slcan_interface_talks_to_an_adapter() -> None:
    far = AdapterBus(open_endpoint("pty"))
    name = address_of(far).removeprefix("serial:")
    with answering(far) as received, open_bus(f"can:slcan:{name}@115200") as stock:
        wait_for(lambda: far.open)
        stock.send(frame(7))
        wait_for(lambda: len(received) == 1)
        far.send(frame(9))
        answer = stock.recv(WAIT_S)
    assert answer is not None and bytes(answer.data) == bytes(frame(9).data)
    far.shutdown()


def test_a_can_bus_is_any_interface_of_python_can() -> None:
    with open_bus("can:virtual:pair@250") as one, open_bus("can:virtual:pair@250") as other:
        one.send(frame(3))
        received = other.recv(WAIT_S)
    assert received is not None and received.arbitration_id == ANGLE.identifier


def test_a_log_gives_its_frames_in_order_and_then_ends(tmp_path: Path) -> None:
    path = tmp_path / "run.asc"
    with can.Logger(path) as log:
        for step in range(5):
            message = frame(step)
            message.timestamp = 1000.0 + 0.01 * step
            log(message)
    bus = LogBus(path)
    received = [bus.recv(1.0) for _ in range(5)]
    assert [bytes(m.data) for m in received if m] == [bytes(frame(step).data) for step in range(5)]
    assert bus.recv(0.0) is None and bus.ended
    bus.shutdown()


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.EAFNOSUPPORT, "this kernel has no CAN"),
        (errno.ENODEV, "there is no interface can7: plug its adapter in"),
        (errno.ENETDOWN, "bring it up with `sudo ip link set can7 up type can bitrate 250000`"),
    ],
)
def test_what_to_do_follows_from_the_error_of_the_interface(
    number: int, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(**options: object) -> can.BusABC:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(can, "Bus", fails)
    with pytest.raises(LinkError) as caught:
        open_bus("can:socketcan:can7@250")
    assert says in str(caught.value) and ("ip link" in says) == ("ip link" in str(caught.value))


@pytest.mark.parametrize(
    ("spec", "kind", "says"),
    [
        ("nonsense", UsageError, "is not a bus"),
        ("serial:", UsageError, "is not a bus"),
        ("serial:/no/such/port", LinkError, "there is no port"),
        ("tcp:127.0.0.1:1", LinkError, "no connection"),
        ("tcp:host", UsageError, "is not an address"),
        ("udp:many", UsageError, "a port is a number"),
        ("can:nothing:0", UsageError, "no interface 'nothing'"),
        ("can:virtual", UsageError, "is not a bus"),
        ("can:socketcand:host", UsageError, "can:socketcand:HOST:PORT:CHANNEL"),
        ("can:socketcan:nothere", LinkError, "cannot be opened"),
        ("file:/no/such.asc", UsageError, "cannot read /no/such.asc"),
    ],
)
def test_what_is_no_bus_gets_one_sentence(spec: str, kind: type[PlumbError], says: str) -> None:
    with pytest.raises(kind, match=says) as caught:
        open_bus(spec).shutdown()
    assert "\n" not in str(caught.value)


def test_a_far_end_waits_on_this_machine_only() -> None:
    with pytest.raises(UsageError, match="this machine only"):
        serve_bus("tcp:192.0.2.1:4000")
    with pytest.raises(UsageError, match="cannot be served as a bus"):
        serve_bus("file:x.asc")


def test_an_endless_line_does_not_grow() -> None:
    far = AdapterBus(open_endpoint("tcp:0"))
    honest, kept, received_bytes = far._line.read, [], [0]

    def read() -> bytes:
        kept.append(len(far._pending))
        data = honest()
        received_bytes[0] += len(data)
        return data

    far._line.read = read  # type: ignore[method-assign]
    with answering(far), PlumbBus(address_of(far)) as near:
        near.write_text(b"x" * 200_000)
        wait_for(lambda: received_bytes[0] >= 200_000)
    assert max(kept) <= 64
    far.shutdown()


@contextmanager
def busy_client(line: ServerEndpoint) -> Iterator[Callable[[], bytes]]:
    """A client that is there and reads only when asked to. The system keeps as little as it can for it."""
    if isinstance(line, TcpEndpoint):
        with socket.socket() as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.connect(("127.0.0.1", int(line.address.rpartition(":")[2])))
            client.setblocking(False)
            while not line.connected:
                line.read()
            assert line._client is not None
            line._client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)

            def read() -> bytes:
                with suppress(BlockingIOError):
                    return client.recv(65536)
                return b""

            yield read
    else:
        with serial.Serial(line.address, timeout=0) as port:
            yield lambda: port.read(65536)


@pytest.mark.parametrize("kind", ["pty", "tcp:0"])
def test_a_client_that_is_busy_for_a_while_loses_nothing(kind: str) -> None:
    """Numbered lines, more than the system keeps, before the client reads the first."""
    line = open_endpoint(kind)
    with busy_client(line) as read:
        said = b"".join(b"t1008%016X\r" % number for number in range(2800))
        for at in range(0, len(said), 220):
            line.write(said[at : at + 220])
        received = read()
        end = time.monotonic() + WAIT_S
        while len(received) < len(said) and time.monotonic() < end:
            line.read()
            received += read()
        assert received == said
    line.close()


def test_backlog_is_dropped_when_the_client_changes() -> None:
    line = open_endpoint("pty")
    assert isinstance(line, PtyEndpoint)
    piece = b"t1008" + b"0" * 16 + b"\r"
    with serial.Serial(line.address, timeout=1):
        for _ in range(2 * BACKLOG_BYTES // len(piece)):
            line.write(piece)
        assert BACKLOG_BYTES - len(piece) < len(line._backlog) <= BACKLOG_BYTES
    line.write(piece)  # nobody is there
    assert len(line._backlog) == 0
    line.close()


def client_of(line: TcpEndpoint) -> socket.socket:
    return socket.create_connection(("127.0.0.1", int(line.address.rpartition(":")[2])))


def receive_on(line: TcpEndpoint, text: bytes) -> list[bool]:
    """Reads until it has come; whether somebody was there after each read."""
    received, there = b"", []
    end = time.monotonic() + WAIT_S
    while received != text:
        assert time.monotonic() < end, received
        received += line.read()
        there.append(line.connected)
    return there


def test_who_comes_when_the_one_before_has_just_gone_is_served() -> None:
    """However late the line looks: the bytes of both clients arrive in order, and between the two no client was
    there."""
    line = open_endpoint("tcp:0")
    assert isinstance(line, TcpEndpoint)
    with client_of(line) as first:
        first.sendall(b"a")
        receive_on(line, b"a")
        first.sendall(b"the last of the first")
    with client_of(line) as second:
        second.sendall(b", and the second")
        there = receive_on(line, b"the last of the first, and the second")
        assert False in there and there[-1]
        with client_of(line) as third:
            third.settimeout(WAIT_S)
            line.read()
            assert third.recv(1) == b""
        assert line.connected
    line.close()

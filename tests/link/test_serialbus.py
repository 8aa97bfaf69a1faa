"""The serial bus: any garbage, any port, any tool; and python-can's own slcan interface, unmodified, on the board."""

from __future__ import annotations

import asyncio
import os
import random
import re
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path

import can
import pytest

from plumb.errors import LinkError
from plumb.link.board_frames import PERIODIC
from plumb.link.session import Session
from plumb.link.transports.slcan import text_of_frames
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from plumb.spec.protocol import Frame, check, protocol
from support.native_board import UartBoard
from support.slow_time import slow_down

WAIT_S = 60.0
"""For what comes at once, on a machine that may have other things to do."""


class Loopback:
    """A stream that gives prepared bytes, in prepared pieces."""

    def __init__(self, pieces: list[bytes]) -> None:
        self.pieces, self.written, self.time = list(pieces), b"", 0.0

    def clock_s(self) -> float:
        self.time += 0.01
        return self.time

    @property
    def in_waiting(self) -> int:
        return sum(map(len, self.pieces))

    def read(self, count: int) -> bytes:
        return self.pieces.pop(0) if self.pieces else b""

    def write(self, data: bytes) -> int:
        self.written += data
        return len(data)


def frames_of(count: int) -> list[Frame]:
    message = protocol()["STEP"]
    return [
        (message.identifier, message.pack(i & 15, 0, i & 0xFFFF, i * 2654435761 & 0xFFFFFFFF)) for i in range(count)
    ]


def everything(bus: PlumbBus) -> list[Frame]:
    found = []
    while frames := bus.read_frames(0.05):
        found += frames
    return found


# ---- garbage ----


@pytest.mark.parametrize("seed", range(20))
def test_recv_never_raises_and_good_frames_come_through(seed: int) -> None:
    rng = random.Random(seed)
    good = frames_of(60)
    stream = bytearray()
    for frame in good:
        stream += rng.choice([b"", rng.randbytes(rng.randrange(80)), b"\xff", b"t1008\xff\r", b"t10081122\r"]) + b"\r"
        stream += text_of_frames([frame])
    pieces = []
    while stream:
        size = rng.choice([1, 3, 22, 100])
        pieces.append(bytes(stream[:size]))
        del stream[:size]
    with PlumbBus(Loopback(pieces)) as bus:
        messages = []
        while (message := bus.recv(0.1)) is not None:
            messages.append((message.arbitration_id, bytes(message.data)))
            assert message.dlc == 8
            assert not message.is_extended_id
    assert messages == good


def test_a_line_two_digits_short_is_not_a_frame() -> None:
    (frame,) = frames_of(1)
    short = text_of_frames([frame])[:-3] + b"\r"
    with PlumbBus(Loopback([short * 5 + text_of_frames([frame])])) as bus:
        assert everything(bus) == [frame]
        assert bus.parser.bad == 5


def test_a_flood_is_taken_whole() -> None:
    good = frames_of(20_000)
    text = text_of_frames(good)
    with PlumbBus(Loopback([text[at : at + 65536] for at in range(0, len(text), 65536)])) as bus:
        assert everything(bus) == good


def test_a_notifier_in_an_event_loop_receives_a_whole_burst(port: str) -> None:
    async def listen(bus: PlumbBus) -> list[int]:
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
        message = protocol()["PARAM_GET"]
        bus.write_frames([(message.identifier, message.pack(0, 0, 0xFFFF, 0))])
        found: list[int] = []
        while found.count(protocol()["PARAM_VALUE"].identifier) < len(parameters.table()):
            found.append((await asyncio.wait_for(reader.get_message(), WAIT_S)).arbitration_id)
        notifier.stop()
        return found

    with PlumbBus(port) as bus:
        asyncio.run(listen(bus))


def test_recv_returns_in_time_without_a_frame() -> None:
    with PlumbBus(Loopback([])) as bus:
        assert bus.recv(0.05) is None
        assert bus.recv(0) is None


def test_filters_and_what_is_sent() -> None:
    stream = Loopback([text_of_frames(frames_of(3))])
    with PlumbBus(stream, can_filters=[{"can_id": 0x7FD, "can_mask": 0x7FF}]) as bus:
        assert bus.recv(0.1) is None
        bus.send(can.Message(arbitration_id=0x7FC, data=bytes(8), is_extended_id=False))
        with pytest.raises(can.CanError, match="11-bit"):
            bus.send(can.Message(arbitration_id=0x12345, is_extended_id=True))
        with pytest.raises(LinkError):
            bus.send(can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(12)))
    assert stream.written == b"\rC\rO\rt7FC80000000000000000\rC\r"
    bus.shutdown()


def test_listen_only_opens_read_only() -> None:
    board = UartBoard()
    with PlumbBus(board, listen_only=True) as bus:
        bus.write_frames(frames_of(1))
        board.run_us(300_000)
        names = {protocol().by_identifier[identifier].name for identifier, _ in bus.read_frames(0.05)}
        assert names == set(PERIODIC)
        assert bus.parser.refused == 1


# ---- ports ----


class Served:
    """A board behind a file descriptor, in real time."""

    def __init__(self, board: UartBoard, fd: int) -> None:
        self.board, self._fd, self._stop = board, fd, threading.Event()
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def _serve(self) -> None:
        os.set_blocking(self._fd, False)
        waiting, start = b"", time.monotonic()
        while not self._stop.is_set():
            try:
                self.board.write(os.read(self._fd, 4096))
            except BlockingIOError:
                time.sleep(0.0005)
            except OSError:
                return
            while self.board.time_us < (time.monotonic() - start) * 1e6:
                self.board.turn(500)
            waiting += self.board.received()
            try:
                waiting = waiting[os.write(self._fd, waiting[:512]) :]
            except BlockingIOError:
                pass
            except OSError:
                return

    def stop(self) -> None:
        self._stop.set()
        self.thread.join(5)


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A board behind a terminal; board and host in slow time."""
    slow_down(monkeypatch)
    master, slave = os.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    served = Served(UartBoard(), master)
    yield os.ttyname(slave)
    served.stop()
    os.close(master)
    os.close(slave)


def test_session_over_a_serial_port(port: str) -> None:
    with Session.open(port) as session:
        assert session.identity is not None
        assert session.identity.mismatch is None
        assert session.read_parameters()


def test_stock_slcan_of_python_can_opens_the_board_and_receives(port: str) -> None:
    with can.Bus(interface="slcan", channel=f"{port}@921600", bitrate=500000, sleep_after_open=0) as bus:
        assert bus.get_version(WAIT_S) == (1, protocol().version)  # type: ignore[attr-defined]
        assert bus.get_serial_number(WAIT_S) == "N0001"[1:]  # type: ignore[attr-defined]
        message = protocol()["HELLO"]
        data = message.pack(0, 0, protocol().version, protocol().dbc_hash)
        bus.send(can.Message(arbitration_id=message.identifier, data=data, is_extended_id=False))
        received: dict[str, bytes] = {}
        end = time.monotonic() + WAIT_S
        wanted = {"IDENTITY", "TIME", "STATUS"}
        while not wanted <= set(received) and time.monotonic() < end:
            frame = bus.recv(0.5)
            if frame is not None:
                assert check(frame.arbitration_id, bytes(frame.data))
                received[protocol().by_identifier[frame.arbitration_id].name] = bytes(frame.data)
        assert wanted <= set(received)


def test_any_python_can_tool_can_use_the_interface(port: str) -> None:
    (found,) = [e for e in entry_points(group="can.interface") if e.name == "plumb"] or [None]  # type: ignore[list-item]
    if found is None:  # not installed, only on the path: what the package would register
        text = (Path(__file__).resolve().parents[2] / "pyproject.toml").read_text()
        registered = re.search(r'entry-points\."can\.interface"\]\nplumb = "(.*)"', text)
        assert registered
        assert registered[1] == "plumb.link.transports.slcan_bus:PlumbBus"
        return
    assert found.load() is PlumbBus
    with can.Bus(interface="plumb", channel=port) as bus:
        assert isinstance(bus, PlumbBus)
        assert bus.recv(WAIT_S) is not None
    logger = [sys.executable, "-u", "-m", "can.logger", "-i", "plumb", "-c", port]
    with subprocess.Popen(logger, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout
        lines = []
        for line in process.stdout:  # until it has logged a TIME, or ended
            lines.append(line)
            if "ID:      110" in line:
                process.terminate()
                break
        else:
            pytest.fail("".join(lines))


def test_a_bus_over_tcp_and_a_board_that_goes_away() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    number = server.getsockname()[1]
    opened: list[socket.socket] = []

    def serve() -> None:
        connection, _ = server.accept()
        opened.append(connection)
        opened_board.append(Served(UartBoard(), connection.fileno()))

    opened_board: list[Served] = []
    threading.Thread(target=serve, daemon=True).start()
    with Session.open(f"socket://127.0.0.1:{number}") as session:
        assert session.read_parameters()
        opened_board[0].stop()
        opened[0].close()
        with pytest.raises(LinkError, match="reconnect") as caught:
            for _ in range(100):
                session.receive(0.1)
        assert isinstance(caught.value, can.CanOperationError)
    server.close()


def test_a_serial_port_that_goes_away() -> None:
    master, slave = os.openpty()
    bus = PlumbBus(os.ttyname(slave))
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkError, match="plug the board in again"):
        for _ in range(10):
            bus.read_frames(0.1)
    bus.shutdown()
    bus.shutdown()


@pytest.mark.parametrize(
    ("channel", "sentence"),
    [
        ("/dev/plumb-none", "there is no port /dev/plumb-none"),
        ("/dev/plumb-none@115200", "there is no port /dev/plumb-none"),
        ("socket://127.0.0.1:1", "no connection to 127.0.0.1:1"),
        ("tcp:nowhere", "is not an address"),
    ],
)
def test_ports_that_cannot_be_opened(channel: str, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence) as caught:
        PlumbBus(channel)
    assert isinstance(caught.value, can.CanInitializationError)
    assert caught.value.exit_code == 3
    assert "\n" not in str(caught.value)


def test_a_port_in_use_says_so(port: str) -> None:
    with PlumbBus(port), pytest.raises(LinkError, match=r"in use by .*: close the other program"):
        PlumbBus(port)


def test_a_port_without_permission_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(13, "could not open port /dev/x: [Errno 13] Permission denied: '/dev/x'")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(LinkError, match="add yourself to the group that owns it"):
        PlumbBus("/dev/x")


def test_an_rfc2217_server_that_does_not_answer_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def refuse(*_: object, **__: object) -> None:
        said = "Remote does not seem to support RFC2217 or BINARY mode ['we-BINARY:False(ACTIVE)']"
        raise serial.SerialException(said)

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(LinkError, match="does not speak RFC 2217") as caught:
        PlumbBus("rfc2217://127.0.0.1:4000")
    assert "False" not in str(caught.value)

"""The served board: a pty or a TCP port that pyserial opens, clients that come and go, and a clean end."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from support.f103_program import NewBoard

serial = pytest.importorskip("serial")
HOST = str(Path(__file__).parents[2] / "host")
WAIT_S = 60.0
"""For what comes at once, on a machine that may have other things to do."""
SERVER = """
import sys
from pathlib import Path
from plumb.f103 import Machine
from plumb.boards.serve import serve
from plumb.process_signals import endings
link = Path(sys.argv[3]) if len(sys.argv) > 3 else None
with endings() as caught:
    machine = Machine(Path(sys.argv[1]))
    serve(machine, sys.argv[2], lambda: bool(caught), link=link, announce=lambda text: print(text, flush=True))
print("ended by", caught[0], flush=True)
"""


class Server:
    """The small echo program, served by a process of its own."""

    def __init__(self, image: Path, *arguments: str) -> None:
        environment = {**os.environ, "PYTHONPATH": HOST}
        command = [sys.executable, "-c", SERVER, str(image), *arguments]
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()

    def end(self, number: int) -> tuple[str, str, int]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=WAIT_S)
        return out.strip(), err.strip(), self.process.returncode


@pytest.fixture
def serve(build: Callable[[str], Path]) -> Iterator[Callable[..., Server]]:
    servers = []

    def start(*arguments: str) -> Server:
        servers.append(Server(build("uart").with_suffix(".bin"), *arguments))
        return servers[-1]

    yield start
    for server in servers:
        server.process.kill()
        server.process.communicate()


def exchange(address: str, data: bytes) -> bytes:
    """What the board says up to the echo of `data`; it may still have something to say to the client before."""
    with serial.serial_for_url(address, 921600, timeout=WAIT_S) as port:
        port.write(data)
        return bytes(port.read_until(data))


def started(address: str) -> None:
    """The board echoes: bytes sent before it ran are lost, later ones are not."""
    with serial.serial_for_url(address, 921600, timeout=0.2) as port:
        for knock in range(round(WAIT_S / 0.2)):
            port.write(b"<%d>" % knock)
            if port.read_until(b"<%d>" % knock).endswith(b"<%d>" % knock):
                return
    pytest.fail("the board does not start")


def test_a_pty_serves_clients_in_turn_under_a_stable_name(serve: Callable[..., Server], tmp_path: Path) -> None:
    link = tmp_path / "board"
    server = serve("pty", str(link))
    started(server.address)
    assert link.resolve() == Path(server.address)
    for address in (server.address, str(link), server.address):
        assert exchange(address, b"hello board\r") == b"hello board\r"
    out, err, code = server.end(signal.SIGTERM)
    assert (out, err, code) == (f"ended by {int(signal.SIGTERM)}", "", 0)
    assert not link.is_symlink()


def test_a_tcp_port_serves_clients_in_turn_and_ends_on_interrupt(serve: Callable[..., Server]) -> None:
    server = serve("tcp:0")
    started(server.address)
    assert server.address.startswith("socket://127.0.0.1:")
    for _ in range(3):
        assert exchange(server.address, bytes(range(200))) == bytes(range(200))
    # A client that goes away in the middle of a transfer does no harm.
    host, port = server.address.removeprefix("socket://").split(":")
    rude = socket.create_connection((host, int(port)))
    rude.sendall(b"x" * 2000)
    rude.close()
    assert exchange(server.address, b"still here").strip(b"x") == b"still here"
    assert server.end(signal.SIGINT) == (f"ended by {int(signal.SIGINT)}", "", 0)


def test_bad_addresses_are_refused_in_a_sentence(build: Callable[[str], Path], tmp_path: Path) -> None:
    from plumb.errors import LinkError, UsageError
    from plumb.link.transports.server_endpoint import open_endpoint

    for wrong in ("usb", "tcp:", "tcp:abc", "pty:1", "tcp:99999"):
        with pytest.raises(UsageError, match="pty or tcp:PORT"):
            open_endpoint(wrong)
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(LinkError, match="choose another"):
        open_endpoint(f"tcp:{taken.getsockname()[1]}")
    plain = tmp_path / "file"
    plain.write_text("precious")
    with pytest.raises(UsageError, match="choose another name"):
        open_endpoint("pty", plain)
    assert plain.read_text() == "precious"


def test_paced_time_never_overtakes_the_wall_clock(board: NewBoard) -> None:
    from plumb.boards.serve import run_paced

    machine = board("systick").machine

    class Silence:
        address = ""
        connected = False

        def watch(self) -> None:
            return None

        def read(self) -> bytes:
            return b""

        def write(self, data: bytes) -> None:
            pass

        def close(self) -> None:
            pass

    ended = threading.Event()
    threading.Timer(0.4, ended.set).start()
    before, begin = machine.now_s, time.monotonic()
    run_paced(machine, Silence(), lambda: ended.is_set() and machine.now_s > before)
    assert 0 < machine.now_s - before <= time.monotonic() - begin

"""The virtual board's CAN bus served to other processes, and stock python-can interfaces that reach it.

All in slow time: a CAN link closes when its host is silent for two seconds.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import can
import pytest

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")

from plumb import __main__ as front
from plumb.boards.serve import run_paced
from plumb.boards.virtual_can import Joint
from plumb.boards.virtual_machine import open_machine
from plumb.errors import LinkError, UsageError
from plumb.flash.image import find_image
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.open_bus import open_bus
from plumb.link.transports.server_endpoint import open_endpoint
from plumb.spec import parameters
from support import slow_time

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

Served = Callable[..., list[str]]


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """--can SPEC, other options -> the names under which the board's ends can be reached: CAN first, then the UART."""
    slow_time.slow_down(monkeypatch)
    processes = []

    def start(spec: str, *options: str) -> list[str]:
        command, environment = slow_time.command("virtual-board", "--serial", "pty", "--can", spec, *options)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        processes.append(process)
        assert process.stdout is not None
        found = [re.search(r"use it as (\S+);", process.stdout.readline()) for _ in range(2)]
        return [match[1] for match in found if match]

    yield start
    for process in processes:
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0


def table_crc(session: Session) -> int:
    return parameters.crc32(session.read_parameters())


@pytest.mark.slow
@pytest.mark.parametrize("spec", ["slcan:pty", "slcan:tcp:0", "socketcand:0"])
def test_a_run_from_another_process(spec: str, served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    """Over the stock slcan interface on a terminal and on TCP, and over socketcand."""
    bus, _ = served(spec)
    assert bus.startswith(f"can:{spec.split(':')[0]}:")
    assert front.main(["run", "quad", "--board", bus, "--seconds", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["metrics"]["target_vs_fixed_mismatches"] == 0


def test_both_ends_from_two_hosts_and_stock_slcan_on_the_uart(served: Served) -> None:
    bus, uart = served("slcan:tcp:0")
    with Session.over(open_bus(bus)) as over_can:
        port = f"{uart.removeprefix('serial:')}@921600"
        stock = can.Bus(interface="slcan", channel=port, bitrate=500000, sleep_after_open=0)
        with Session.over(stock) as over_uart:
            assert table_crc(over_can) == table_crc(over_uart)
            over_uart.begin("LOCKSTEP")
            with pytest.raises(LinkError, match="from another link"):
                over_can.request("SAMPLE_A", 1, 2, 3)
            assert over_can.end() == 0  # anybody may end it
    with Session.over(open_bus(bus)) as again:
        assert again.identity is not None and again.identity.mismatch is None


RUNNING_HOST = """
import sys
from support import slow_time
slow_time.begin()
from plumb.link.transports.open_bus import open_bus
from plumb.link.session import Session

with Session.over(open_bus(sys.argv[1])) as session:
    session.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    print("runs", flush=True)
    while True:
        session.receive(0.01)
"""


@pytest.mark.slow
def test_one_of_two_hosts_is_killed_and_the_other_loses_nothing(served: Served) -> None:
    """Both receive every step of a run that was begun over CAN; its host dies, the run goes on for the other one."""
    bus, uart = served("slcan:tcp:0", "--system", "quad")
    _, environment = slow_time.command()
    host = subprocess.Popen(
        [sys.executable, "-c", RUNNING_HOST, bus], stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        assert host.stdout is not None and host.stdout.readline() == "runs\n"
        with Session.open(uart.removeprefix("serial:")) as watcher:
            capture = Capture(watcher, raw_frames=("RAW_A",))
            watcher.listener = capture.feed
            for steps, then in (
                (20, host.kill),
                (130, watcher.end),
            ):  # 2.2 s later: the dead host's link is closed by then
                while len(capture.digest) < steps:
                    watcher.receive(0.02)
                then()
            first, last = min(capture.digest), max(capture.digest)
            assert sorted(capture.digest) == list(range(first, last + 1))
            assert set(range(first + 1, last)) <= set(capture.raw)
            assert watcher.counters.lost == watcher.frames.rejected == 0
        with Session.over(open_bus(bus)) as again:  # the CAN link is free for the next one
            assert again.read_parameters()
    finally:
        host.kill()
        host.wait()


@pytest.mark.slow
def test_an_adapter_set_to_another_bit_rate_receives_nothing(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    bus, _ = served("slcan:tcp:0")
    channel = bus.removeprefix("can:slcan:")
    for bitrate in (250_000, 500_000):
        other = can.Bus(interface="slcan", channel=channel, bitrate=bitrate, sleep_after_open=0)
        if bitrate == 250_000:
            with monkeypatch.context() as short:
                short.setattr("plumb.link.board_frames.REPLY_TIMEOUT_S", 0.02)
                with pytest.raises(LinkError, match="can_bitrate_kbit is the bus's bit rate"):
                    Session.over(other)
        else:
            with Session.over(other) as session:
                assert session.read_parameters()
                while "CAN_HEALTH" not in session.telemetry:
                    session.receive(0.05)
                assert session.telemetry["CAN_HEALTH"]["bus_offs"] == 0


def test_any_python_can_bus_can_be_the_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    """python-can's own virtual bus, with other traffic on it: the machine is one node of it."""
    slow_time.slow_down(monkeypatch)
    machine, line = open_machine(), open_endpoint("pty")
    node, host, stranger = (can.Bus(interface="virtual", channel="joint", receive_own_messages=False) for _ in range(3))
    stop = threading.Event()
    runner = threading.Thread(target=run_paced, args=(machine, line, stop.is_set, Joint(machine, node, 500)))
    runner.start()
    try:
        stranger.send(can.Message(arbitration_id=0x18FF50E5, is_extended_id=True, data=bytes(8)))
        stranger.send(can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=4))
        with Session.over(host) as session:
            assert session.read_parameters()
        assert machine.warnings == []
    finally:
        stop.set()
        runner.join()
        line.close()
        node.shutdown()
        stranger.shutdown()


@pytest.mark.parametrize("spec", ["none:0", "socketcand:x", "slcan"])
def test_no_way_to_serve_is_wrong_use(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["virtual-board", "--serial", "pty", "--can", spec]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1

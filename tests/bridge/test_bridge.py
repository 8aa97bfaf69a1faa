"""Sensor board, bridge and STM32 as processes of their own: joined over ptys, sockets and slcan, in any order, killed
and started again, with the model in step. They live in slow time (support/slow_time.py): each has to
keep up with the others."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb.bridge.bridge import ARM_AFTER_STEPS
from plumb.bridge.frame_counts import Flow
from plumb.contract import run_fixed
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.proof.shadow import Shadow
from plumb.spec.protocol import protocol
from plumb.systems.quad import scenarios as quad
from support import slow_time
from support.native_board import UartBoard

IntArray = np.ndarray[Any, np.dtype[Any]]


class Process:
    """A plumb command; what it says is read as it says it. A wait ends with the process, or with the test's own limit
    of time."""

    def __init__(self, folder: Path, *arguments: str, slow: bool = True) -> None:
        self.out, self.err = folder / f"{arguments[0]}.out", folder / f"{arguments[0]}.err"
        command, environment = slow_time.command(*arguments) if slow else slow_time.in_wall_time(*arguments)
        self.process = subprocess.Popen(command, stdout=self.out.open("w"), stderr=self.err.open("w"), env=environment)

    def wait_for(self, text: str, times: int = 1) -> None:
        while self.said().count(text) < times:
            assert self.process.poll() is None, f"ended without '{text}': {self.said()}"
            time.sleep(0.02)

    def said(self) -> str:
        return self.out.read_text() + self.err.read_text()

    def end(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait()

    def ended(self, code: int, number: int = signal.SIGTERM) -> dict[str, Any]:
        """Asked to end, it does so with this code; what it says about itself in JSON."""
        assert self.end(number) == code, self.said()
        found = json.loads(self.out.read_text())
        assert isinstance(found, dict)
        return found


Start = Callable[..., Process]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    try:
        find_image()
    except UsageError as error:
        pytest.skip(str(error))
    started: list[Process] = []

    def begin(*arguments: str, slow: bool = True) -> Process:
        started.append(Process(tmp_path, *arguments, slow=slow))
        return started[-1]

    yield begin
    for one in started:
        one.process.kill()
        one.process.wait()
        print(one.said())  # shown with a test that failed


ARMED = "plumb: armed\n"
SENSOR = ("sensor-board", "quad", "--scenario", "hold")


@pytest.mark.slow
@pytest.mark.parametrize("order", ["sensor board bridge", "bridge board sensor", "board bridge sensor"])
def test_the_three_processes_find_each_other_in_any_order(start: Start, tmp_path: Path, order: str) -> None:
    """Over pseudo-terminals with names that stay."""
    sensor, board = tmp_path / "sensor", tmp_path / "board"
    commands = {
        "sensor": (*SENSOR, "--bus", "serial:pty", "--symlink", str(sensor)),
        "board": ("virtual-board", "--serial", "pty", "--symlink", str(board)),
        "bridge": ("bridge", f"serial:{sensor}", f"serial:{board}", "--arm", "--shadow", "--json"),
    }
    up = {"sensor": "sends samples", "board": "serving", "bridge": "plumb: "}
    running = {}
    for name in order.split():
        running[name] = start(*commands[name])
        running[name].wait_for(up[name])
    running["bridge"].wait_for(ARMED)
    found = running["bridge"].ended(0)
    assert found["verdict"] == "pass" and found["verified_steps"] >= ARM_AFTER_STEPS


@pytest.mark.slow
def test_either_side_may_be_killed_and_started_again(start: Start, tmp_path: Path) -> None:
    """And an armed run that was cut off is not armed again by itself."""
    sensor, board = tmp_path / "sensor", tmp_path / "board"
    sensor_command = (*SENSOR, "--bus", "serial:pty", "--symlink", str(sensor))
    board_command = ("virtual-board", "--serial", "pty", "--symlink", str(board))
    sensor_process, board_process = start(*sensor_command), start(*board_command)
    bridge = start("bridge", f"serial:{sensor}", f"serial:{board}", "--arm", "--shadow", "--json")
    bridge.wait_for(ARMED)
    board_process.end(signal.SIGKILL)
    board.unlink()  # as the name of an adapter that is unplugged goes; the terminal may be somebody else's from here on
    bridge.wait_for("the board's side:")
    start(*board_command)
    bridge.wait_for("run 2:")
    sensor_process.end(signal.SIGKILL)
    sensor.unlink()
    bridge.wait_for("fell silent")
    start(*sensor_command)
    bridge.wait_for("run 3:")
    assert bridge.ended(130, signal.SIGINT)["verdict"] == "pass"
    assert bridge.said().count(ARMED) == 1


@pytest.mark.slow
def test_one_side_may_be_a_can_bus(start: Start, tmp_path: Path) -> None:
    """Stock python-can slcan on the sensor board's side, TCP on the board's."""
    sensor = tmp_path / "sensor"
    start(*SENSOR, "--open-loop", "--bus", "serial:pty", "--symlink", str(sensor))
    board = start("virtual-board", "--serial", "tcp:0")
    board.wait_for("serving")
    port = board.said().split("127.0.0.1:")[1].split(";")[0]
    bridge = start("bridge", f"can:slcan:{sensor}@115200", f"tcp:127.0.0.1:{port}", "--arm", "--shadow", "--json")
    bridge.wait_for(ARMED)
    assert bridge.ended(0)["verdict"] == "pass"


def test_another_host_sees_the_board_through_a_carrying_bridge(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    """`plumb monitor` would do: here a session over TCP, the bridge, and the board's TCP port."""
    slow_time.slow_down(monkeypatch)
    from plumb.link.transports.open_bus import serve_bus
    from plumb.link.transports.slcan_server import AdapterBus

    board = start("virtual-board", "--serial", "tcp:0")
    board.wait_for("serving")
    port = board.said().split("127.0.0.1:")[1].split(";")[0]
    far = serve_bus("tcp:127.0.0.1:0")
    assert isinstance(far, AdapterBus)
    address = far.channel_info.split("//")[1]
    bridge = start("bridge", f"tcp:{address}", f"tcp:127.0.0.1:{port}", "--carry", "--json")
    while far.recv(0.02) is None:  # the first telemetry: both sides are open
        assert bridge.process.poll() is None, bridge.said()
    with Session(far) as session:
        assert session.connect().mismatch is None
        session.begin("LOCKSTEP")
        session.end()
    first = bridge.ended(0)["first"]
    assert first["frames"] > 3 and first["lost"] == first["rejected"] == 0


def test_a_bus_that_is_none_gets_one_sentence(start: Start) -> None:
    wrong = start("bridge", "nonsense", "tcp:127.0.0.1:1", slow=False)
    assert wrong.process.wait() == 2
    assert wrong.said().count("\n") == 1 and "is not a bus" in wrong.said()


@pytest.mark.slow
def test_sides_that_are_swapped_are_named_and_link_trouble(start: Start, tmp_path: Path) -> None:
    sensor, board = tmp_path / "sensor", tmp_path / "board"
    start(*SENSOR, "--bus", "serial:pty", "--symlink", str(sensor), slow=False).wait_for("sends samples")
    start("virtual-board", "--serial", "pty", "--symlink", str(board), slow=False).wait_for("serving")
    bridge = start("bridge", f"serial:{board}", f"serial:{sensor}", slow=False)
    bridge.wait_for("is an STM32 board, not a sensor board")
    bridge.wait_for("does not answer")
    assert bridge.end() == 3, bridge.said()
    assert "Traceback" not in bridge.said()


@pytest.fixture
def nobody() -> Iterator[tuple[str, str]]:
    """Names of a TCP port at which nobody listens, and of a UDP port at which nobody answers, as long as this lasts."""
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
        for one in (tcp, udp):
            one.bind(("127.0.0.1", 0))
        yield f"tcp:127.0.0.1:{tcp.getsockname()[1]}", f"udp:{udp.getsockname()[1]}"


@pytest.mark.slow
def test_a_bridge_that_never_had_a_sample_says_so_and_is_link_trouble(
    start: Start, tmp_path: Path, nobody: tuple[str, str]
) -> None:
    board = tmp_path / "board"
    start("virtual-board", "--serial", "pty", "--symlink", str(board), slow=False).wait_for("serving")
    bridge = start("bridge", nobody[1], f"serial:{board}", "--json", slow=False)
    bridge.wait_for(f"no sample has come over {nobody[1]} yet")
    assert bridge.ended(3)["runs"] == 0


@pytest.mark.slow
def test_a_killed_bridge_loses_the_armed_board_and_the_next_one_goes_on(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a CAN bus, where nobody else says that a host went away."""
    slow_time.slow_down(monkeypatch)
    sensor, board = tmp_path / "sensor", tmp_path / "board"
    start(*SENSOR, "--bus", "serial:pty", "--symlink", str(sensor)).wait_for("sends samples")
    served = start("virtual-board", "--symlink", str(board), "--can", "socketcand:0")
    served.wait_for("serving", times=2)
    bus = served.said().split("use it as ")[1].split(";")[0]
    command = ("bridge", f"serial:{sensor}", bus, "--arm", "--shadow", "--json")
    first = start(*command)
    first.wait_for(ARMED)
    first.end(signal.SIGKILL)
    with Session.open(str(board)) as watcher:
        while watcher.telemetry.get("STATUS", {"armed": 1})["armed"]:
            watcher.receive(0.05)
        watcher.telemetry.pop("EVENTS", None)  # may be from before it disarmed
        while "EVENTS" not in watcher.telemetry:
            watcher.receive(0.05)
        assert watcher.telemetry["EVENTS"]["disarm_cause"] == 0x20
        second = start(*command)
        second.wait_for(ARMED)
    assert second.ended(0)["verdict"] == "pass"


def test_direct_is_for_a_bus(start: Start) -> None:
    bridge = start("bridge", "serial:/dev/null", "tcp:127.0.0.1:1", "--direct", slow=False)
    assert bridge.process.wait() == 2 and "name that bus first" in bridge.said()


@pytest.mark.parametrize("side", ["first", "second"])
def test_carrying_to_a_side_that_never_opens_is_link_trouble(start: Start, side: str, nobody: tuple[str, str]) -> None:
    nowhere, somewhere = nobody
    bridge = start(
        "bridge", *((nowhere, somewhere) if side == "first" else (somewhere, nowhere)), "--carry", "--json", slow=False
    )
    bridge.wait_for(f"{nowhere}: no connection")
    assert bridge.ended(3)[side]["opened"] == 0


# ---- the shadow ----

ADAPTIVE = quantise(quad.ADAPTIVE)
STEPS = 60


@pytest.fixture
def session() -> Iterator[Session]:
    with Session(PlumbBus(UartBoard())) as opened:
        opened.connect()
        yield opened


def a_run() -> tuple[IntArray, IntArray]:
    """Counts and digests of a board that is right."""
    raw = quad.scenario("motion", 3, seconds=10.0).counts()[:STEPS]
    return raw, run_fixed.run_control(ADAPTIVE, raw, np.zeros(STEPS, np.int32)).digests()


def follow(shadow: Shadow, session: Session, raw: IntArray, digests: IntArray, lost: int = 0) -> None:
    """Every step of a run, then so many frames missing, reported to the shadow."""
    capture = Capture(session)
    shadow.follow(capture, 0)
    for step, (counts, digest) in enumerate(zip(raw.tolist(), digests.tolist(), strict=True)):
        capture.raw[step], capture.digest[step] = counts, digest
    capture.steps = len(raw)
    shadow.follow(capture, lost)


def test_the_shadow_agrees_with_a_board_that_is_right(session: Session) -> None:
    shadow = Shadow(ADAPTIVE)
    follow(shadow, session, *a_run())
    assert shadow.verdict == "pass"
    assert shadow.steps == STEPS - 1  # of the last it is not known whether all of it came


def test_a_single_wrong_digest_stops_the_shadow_at_its_step(session: Session) -> None:
    shadow, (raw, digests) = Shadow(ADAPTIVE), a_run()
    digests[17] ^= 1 << 9
    follow(shadow, session, raw, digests)
    assert shadow.verdict == "fail" and shadow.divergence is not None
    shadow.locate(session)  # the real core repeats the run: every word of it is right this time
    assert (shadow.divergence.step, shadow.divergence.signal, shadow.steps) == (17, "digest", 17)


def test_the_first_word_that_differs_is_named(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model with another gain stands for a board with another gain."""
    other = quantise(replace(quad.ADAPTIVE, pid=replace(quad.PID, kp_per_deg=0.05)))
    honest = run_fixed.run_control
    raw, digests = a_run()
    shadow = Shadow(ADAPTIVE)
    shadow._model = run_fixed.Controller(other)
    follow(shadow, session, raw, digests)
    assert shadow.divergence is not None
    monkeypatch.setattr(run_fixed, "run_control", lambda _, *inputs: honest(other, *inputs))
    shadow.locate(session)
    assert shadow.divergence.signal == "command_q22"
    assert shadow.divergence.expected != shadow.divergence.actual


def test_what_was_lost_on_the_link_is_unverified_and_no_fault_of_the_board(session: Session) -> None:
    raw, digests = a_run()
    digests[17] ^= 1  # as a setpoint that got lost would do
    shadow = Shadow(ADAPTIVE)
    follow(shadow, session, raw, digests, lost=1)
    assert (shadow.verdict, shadow.unverified_from) == ("unverified", 17)
    capture, shadow = Capture(session), Shadow(ADAPTIVE)
    capture.steps = 5
    shadow.follow(capture, 0)
    assert (shadow.verdict, shadow.unverified_from) == ("unverified", 0)
    assert Shadow(ADAPTIVE, shadow).verdict == "unverified"  # a run after it does not make it good


# ---- counting ----


def test_what_goes_by_is_counted_by_its_numbers() -> None:
    flow, messages = Flow(), protocol()
    sample, angle = messages["SAMPLE_A"], messages["QUAD_ANGLE"]
    for step in (5, 6, 9):
        assert flow.note(sample.identifier, sample.pack(step & 15, step >> 4, 1, 2, 3))
    for counter in (15, 0, 0):  # the last: sixteen later, fifteen missing
        assert flow.note(angle.identifier, angle.pack(counter, 0, 1, 2))
    assert (flow.frames, flow.lost) == (6, 2 + 15)
    hello = messages["HELLO"]
    for _ in range(2):  # a host that says it again, as nobody answered, begins to count again
        assert flow.note(hello.identifier, hello.pack(0, 0, 1, 2))
    assert flow.note(angle.identifier, angle.pack(7, 0, 1, 2))
    assert not flow.note(angle.identifier, bytes(8))
    assert not flow.note(0x7FF, bytes(8))
    assert (flow.frames, flow.lost, flow.rejected, flow.foreign) == (9, 2 + 15, 1, 1)
    flow.forget()
    assert flow.note(angle.identifier, angle.pack(12, 0, 1, 2)) and flow.lost == 17

"""What the bridge makes of either side's ways: a board that is reset while its cable stays, counters that were not at
zero, a port that turns out to be the other one, and both sides on one bus. Live in slow time (support/slow_time.py)."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import can
import pytest

from plumb.bridge.bridge import BACKLOG_WINDOW, Bridge
from plumb.bridge.bus_tap import BusTap
from plumb.bridge.frame_counts import BoardCounts
from plumb.bridge.sensor_board import RESET_AFTER_S, SensorBoard
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.link.sample_codec import sample_frames
from plumb.link.session import Session
from plumb.link.transports.open_bus import open_bus, serve_bus
from plumb.link.transports.server_endpoint import TcpEndpoint
from plumb.spec import dbc
from plumb.spec.protocol import protocol
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.plant import QuadPlant
from support.native_board import UartBoard
from support.slow_time import slow_down

TURN_US = 1000
GIVE_UP_US = 50_000
HELD_SAMPLES = 15


class ServedBoard:
    """The firmware's session on a TCP port at the pace of the wall clock. held: it stands still, and does not make up
    for it afterwards."""

    def __init__(self) -> None:
        self.line, self.memory, self.held = TcpEndpoint(0), UartBoard(), False
        self.spec = self.line.address.replace("socket://", "tcp:")
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        begin_s = time.monotonic()
        while not self._done.is_set():
            behind_us = int((time.monotonic() - begin_s) * 1e6) - self.memory.time_us
            if self.held or behind_us > GIVE_UP_US:
                begin_s += behind_us * 1e-6
            elif behind_us >= TURN_US:
                self.memory.write(self.line.read())
                self.memory.turn(TURN_US)
                self.line.write(self.memory.received())
                continue
            time.sleep(0.0005)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self.line.close()


class ServedSensors:
    """A quad's sensor board on a bus, in a thread, which goes by this clock. held: no samples for now."""

    def __init__(self, bus: can.BusABC, clock: Callable[[], float], *, greet: bool = False) -> None:
        scenario = quad.scenario("hold", 1000, period_us=quad.PERIOD_US)
        self.bus, self.held, self._done = bus, False, threading.Event()
        self.board = SensorBoard(
            bus,
            lambda: quad.plant(scenario, open_loop=True),
            quad.PERIOD_US,
            dbc.output_frames("quad"),
            clock,
            greet=greet,
        )
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set():
            self.board.run(lambda: self.held or self._done.is_set())
            time.sleep(0.01)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self.bus.shutdown()


class Running:
    """A bridge in a thread; said: its messages."""

    def __init__(self, sensor: str, board: str, **options: Any) -> None:
        self.said: list[str] = []
        self._done = threading.Event()
        params, link = quantise(quad.ADAPTIVE), {"period_us": quad.PERIOD_US, "arm_hold_ms": 0}
        self.bridge = Bridge(sensor, board, params, ("QUAD_ANGLE",), link, say=self.said.append, **options)
        self._thread = threading.Thread(target=self.bridge.run, args=(self._done.is_set,))
        self._thread.start()

    def wait_for(self, what: str | Callable[[], bool]) -> None:
        while not (any(what in text for text in self.said) if isinstance(what, str) else what()):
            assert self._thread.is_alive(), self.said
            time.sleep(0.01)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        print(*self.said, sep="\n")  # shown with a test that failed


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    slow_down(monkeypatch)


@pytest.fixture
def sides(slow: None) -> Iterator[tuple[ServedBoard, ServedSensors, str]]:
    """A board, a sensor board, and the name of the sensor board's bus."""
    far = serve_bus("tcp:127.0.0.1:0")
    board, sensors = ServedBoard(), ServedSensors(far, time.monotonic)
    yield board, sensors, far.channel_info.split("on ")[1].replace("socket://", "tcp:")
    sensors.close()
    board.close()


@pytest.mark.slow
def test_a_board_that_is_reset_while_its_cable_stays_is_taken_up_again(
    sides: tuple[ServedBoard, ServedSensors, str],
) -> None:
    """A real adapter stays open over a RESET: that the board says nothing any more is all there is to see."""
    board, _, sensor = sides
    running = Running(sensor, board.spec, shadow=True)
    try:
        running.wait_for("run 1:")
        running.wait_for(lambda: running.bridge.steps > 10)
        board.memory.reset()
        running.wait_for("fell silent")
        running.wait_for("run 2:")
        before = running.bridge.steps
        running.wait_for(lambda: running.bridge.steps > before + 10)
    finally:
        running.close()
    assert running.bridge.shadow is not None and running.bridge.shadow.verdict == "pass"


def test_the_board_misses_the_samples_that_the_bridge_leaves_out(
    sides: tuple[ServedBoard, ServedSensors, str],
) -> None:
    """What it missed before does not count."""
    board, sensors, sensor = sides
    with Session(open_bus(board.spec)) as before:  # a host whose samples had gaps
        before.connect()
        before.begin("REALTIME_INJECTED")
        for step in (0, 9):
            before.send(sample_frames(protocol(), step, (2000,) * 6))
        while before.telemetry.get("COUNTERS", {}).get("lost") != 8:
            before.receive(0.1)
    running = Running(sensor, board.spec)
    try:
        running.wait_for(lambda: running.bridge.steps > 10)
        running.wait_for(lambda: running.bridge.counted.lost == running.bridge.skipped)
        while running.bridge.skipped == 0:
            sent, board.held = sensors.board.sent, True  # samples pile up, and stay until some are left out
            running.wait_for(lambda: sensors.board.sent >= sent + HELD_SAMPLES)  # noqa: B023
            steps, board.held = running.bridge.steps, False
            running.wait_for(lambda: running.bridge.skipped > 0 or running.bridge.steps > steps + 3 * BACKLOG_WINDOW)  # noqa: B023
        running.wait_for(lambda: running.bridge.counted.lost == running.bridge.skipped)
    finally:
        running.close()


def test_a_port_that_turns_out_to_be_the_boards_is_left_to_the_boards_side(
    sides: tuple[ServedBoard, ServedSensors, str],
) -> None:
    """As when a sensor board was killed, and its terminal's number given to the board that started next."""
    board, _, sensor = sides
    sensor_is = [board.spec, sensor]

    def open_(name: str) -> can.BusABC:
        if name == "sensor":
            bus = open_bus(sensor_is[0])
            del sensor_is[:-1]
            return bus
        if len(sensor_is) > 1:
            raise LinkError("the other side comes first")
        return open_bus(board.spec)

    running = Running("sensor", "board", open_=open_)
    try:
        running.wait_for("is an STM32 board, not a sensor board")
        running.wait_for("run 1:")
    finally:
        running.close()


@pytest.mark.slow
@pytest.mark.parametrize("direct", [False, True])
def test_sensor_board_and_stm32_may_meet_on_one_can_bus(slow: None, direct: bool) -> None:
    """The board as a node of python-can's bus in this process, with the sensor board as another one. direct: the bridge
    owns and arms the run over the UART, and names the bus as the source of samples."""
    pytest.importorskip("unicorn")
    from plumb.boards.serve import run_paced
    from plumb.boards.virtual_can import Joint
    from plumb.boards.virtual_machine import open_machine
    from plumb.link.transports.server_endpoint import PtyEndpoint

    try:
        machine = open_machine()
    except UsageError as error:
        pytest.skip(str(error))
    spec, done = f"can:virtual:one bus {direct}", threading.Event()
    line, node = PtyEndpoint(), open_bus(spec)
    thread = threading.Thread(target=run_paced, args=(machine, line, done.is_set, Joint(machine, node, 500)))
    thread.start()
    sensors = ServedSensors(open_bus(spec), lambda: machine.now_s, greet=True)
    running = Running(spec, f"serial:{line.address}" if direct else spec, shadow=True, direct=direct, arm=True)
    try:
        running.wait_for("run 1:")
        running.wait_for(lambda: "armed" in running.said)
        running.wait_for(lambda: running.bridge.steps > 50)
        assert running.bridge.counted.lost == running.bridge.skipped == 0
        assert running.bridge.sensor.flow.frames <= sensors.board.sent + 1  # each side's frames are its own
        assert protocol()["SAMPLE_A"].identifier not in running.bridge.board._last
    finally:
        running.close()
        sensors.close()
        done.set()
        thread.join()
        line.close()
        node.shutdown()
    assert running.bridge.shadow is not None and running.bridge.shadow.verdict == "pass"
    assert not any("is an STM32 board" in text for text in running.said)


def test_the_boards_counters_are_counted_on_over_their_end() -> None:
    counts = BoardCounts()
    for lost, starved in ((65530, 7), (3, 9), (4, 9)):
        counts.note({"COUNTERS": {"rejected": 1, "lost": lost, "dropped": 0}, "EVENTS": {"starved": starved}})
    assert (counts.lost, counts.starved, counts.rejected) == (10, 2, 0)
    counts.forget()  # the next board may have started a moment ago
    counts.note({"COUNTERS": {"rejected": 0, "lost": 0, "dropped": 0}})
    assert counts.lost == 10


def test_the_plant_rests_until_armed_and_is_reset_after_a_disarm() -> None:
    """`hold` is let go after 3 s: with nobody there to hold it, it would be gone before it could be armed."""
    times: list[float] = []

    class Noted(QuadPlant):
        def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
            times.append(time_s)
            super().follow(time_s, outputs)

    bus = can.Bus(interface="virtual", channel="rests", receive_own_messages=False)
    stm32 = can.Bus(interface="virtual", channel="rests", receive_own_messages=False)
    step = protocol()["STEP"]
    board = SensorBoard(
        bus,
        lambda: Noted(quad.scenario("hold", 1, period_us=quad.PERIOD_US)),
        quad.PERIOD_US,
        dbc.output_frames("quad"),
        clock=lambda: 0.02 * len(times),
        rest_s=2.0,
    )

    def emit(samples: int, *, armed: bool) -> None:
        for _ in range(samples):
            data = step.pack(0, int(armed), *(0 for _ in step.words))
            stm32.send(can.Message(arbitration_id=step.identifier, data=data, is_extended_id=False))
            board.emit()

    emit(350, armed=False)
    assert max(times) < 2.0 and times[:100] == times[100:200]
    emit(1, armed=True)
    emit(149, armed=True)
    assert times[350:] == pytest.approx([1.0 + 0.02 * step for step in range(150)])
    fallen, gap = board.plant, round(RESET_AFTER_S / 0.02)
    emit(gap - 1, armed=False)
    assert board.plant is fallen and times[-1] == pytest.approx(4.0 + 0.02 * (gap - 2))
    emit(3, armed=False)
    assert board.plant is not fallen and times[-1] < 0.1
    bus.shutdown()
    stm32.shutdown()


class ListeningBus:
    """A bus of listeners: keeps what it was sent. talk: frames that the listeners send; broken: it fails."""

    def __init__(self) -> None:
        self.received: list[int] = []
        self.talk: list[can.Message] = []
        self.broken = False

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("gone")
        self.received.append(message.arbitration_id)

    def recv(self, _timeout: float | None = None) -> can.Message | None:
        return self.talk.pop() if self.talk else None


def tap_of(bus: ListeningBus, said: list[str]) -> BusTap:
    return BusTap(bus, said.append)  # type: ignore[arg-type]


def test_listeners_of_a_bridge_see_both_sides_and_move_nothing(sides: tuple[ServedBoard, ServedSensors, str]) -> None:
    board, _, sensor = sides
    bus, said = ListeningBus(), []  # type: ignore[var-annotated]
    tap = tap_of(bus, said)
    running = Running(sensor, board.spec, tap=tap.send)
    try:
        running.wait_for("run 1:")
        running.wait_for(lambda: running.bridge.steps > 10)
        disarm = protocol()["DISARM"]
        bus.talk = [can.Message(arbitration_id=disarm.identifier, data=disarm.pack(0, 0, 0, 0)) for _ in range(3)]
        tap.serve()
        assert tap.discarded == 3 and bus.talk == []
        wanted = {protocol()[name].identifier for name in ("SAMPLE_A", "STEP", "RAW_A", "QUAD_ANGLE", "TIME", "ACK")}
        assert wanted <= set(bus.received)
        bus.broken = True
        steps = running.bridge.steps
        running.wait_for(lambda: running.bridge.steps > steps + 10)
    finally:
        running.close()
    assert said == ["the frames are no longer served: gone"]


def test_a_talkative_listener_does_not_hold_up_the_bridge() -> None:
    bus = ListeningBus()
    bus.talk = [can.Message(arbitration_id=1) for _ in range(10_000)]
    tap = tap_of(bus, [])
    tap.serve()
    assert tap.discarded == 100

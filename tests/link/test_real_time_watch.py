"""Work that falls behind real time says so, once, and once more when it keeps up again."""

from __future__ import annotations

import pytest

from plumb.boards import serve
from plumb.bridge.sensor_board import SensorBoard
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.link.real_time_watch import RealTimeWatch
from plumb.link.transports.open_bus import serve_bus
from plumb.spec import dbc
from plumb.systems.quad import scenarios as quad


def test_it_speaks_when_it_changes_and_not_between() -> None:
    said: list[str] = []
    now_s = done = 0.0
    watch = RealTimeWatch("the board", "buy a faster one", said.append, lambda: now_s)
    for speed, seconds in ((1.0, 10), (0.97, 10), (0.5, 20), (0.97, 10), (1.0, 10)):
        for _ in range(seconds):
            now_s, done = now_s + 1.0, done + speed
            watch.note(done, now_s)
    assert len(said) == 2 and said[1] == "the board runs in real time again"
    assert said[0].startswith("the board runs at ") and said[0].endswith(" % of real time: buy a faster one")
    watch.note(done, now_s)  # nothing due since: no division by zero


def test_a_short_stall_is_no_news() -> None:
    said: list[str] = []
    now_s = 0.0
    watch = RealTimeWatch("the board", "", said.append, lambda: now_s)
    for done in (0.0, 1.0, 1.0, 3.0, 4.0, 5.0, 6.0, 7.0):
        watch.note(done, now_s)
        now_s += 1.0
    assert said == []


class SlowMachine:
    """A board whose simulated time gains at most 0.5 ms in a turn; every turn takes 1 ms."""

    def __init__(self) -> None:
        self.now, self.wall_s, self.uart = 0, 0.0, self
        self.in_waiting = 0

    def run_to(self, ticks: int) -> None:
        self.now += min(ticks - self.now, TICKS_PER_S // 2000)
        self.wall_s += 0.001

    def read(self, _size: int = 0) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        return len(data)


class NoLine:
    address = "nowhere"
    connected = False

    def watch(self) -> None: ...
    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


def test_the_virtual_board_says_that_this_machine_is_too_slow() -> None:
    said: list[str] = []
    machine = SlowMachine()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("time.monotonic", lambda: machine.wall_s)
        patch.setattr("select.select", lambda *_: ([], [], []))
        serve.run_paced(machine, NoLine(), lambda: machine.wall_s > 10.0, say=said.append)
    assert len(said) == 1 and said[0].startswith("the virtual board runs at 50 % of real time")


def test_the_sensor_board_says_that_this_machine_is_too_slow() -> None:
    said: list[str] = []
    now_s = 0.0

    def clock() -> float:
        nonlocal now_s
        now_s += 0.013  # every look at the clock: several of them a period of 20 ms
        return now_s

    with serve_bus("udp:0") as bus:
        scenario = quad.scenario("hold", 1000, period_us=quad.PERIOD_US)
        board = SensorBoard(
            bus, lambda: quad.plant(scenario), quad.PERIOD_US, dbc.output_frames("quad"), clock, say=said.append
        )
        board.run(lambda: now_s > 8.0)
    assert board.late > 0
    assert len(said) == 1 and said[0].startswith("the sensor board runs at ")

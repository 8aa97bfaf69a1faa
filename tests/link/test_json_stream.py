"""Telemetry as JSON over UDP: what a plotting program receives."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.errors import LinkError, UsageError
from plumb.link.json_stream import JsonStream, StepClock, parse_target
from plumb.link.monitor import begin_live, watch
from plumb.link.session import Session
from support.native_board import UartBoard

RAW = (1690, 2300, 3000, 0, 0, 0)


@pytest.fixture
def plotter() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        one.bind(("127.0.0.1", 0))
        one.setblocking(False)
        yield one


def received(plotter: socket.socket) -> list[dict[str, Any]]:
    found = []
    while True:
        try:
            found.append(json.loads(plotter.recv(65536)))
        except BlockingIOError:
            return found


def board_of(raw: tuple[int, ...] = RAW) -> UartBoard:
    board = UartBoard()
    board.sensors(raw)
    return board


def test_every_step_is_a_datagram_with_its_time(plotter: socket.socket) -> None:
    stream = JsonStream("127.0.0.1", plotter.getsockname()[1])
    with Session.open(board_of()) as session:
        begin_live(session)
        looks = list(watch(session, 2.0, also=stream.feed))
        session.end()
    stream.close()
    datagrams = received(plotter)
    assert len(datagrams) == stream.sent
    steps = [one for one in datagrams if "quad" in one]
    numbers = [one["quad"]["step"] for one in steps]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) and len(numbers) > 80
    gaps = [after["timestamp"] - before["timestamp"] for before, after in pairwise(steps)]
    # A step every 20 ms, by the board's clock, to a quarter of it.
    assert min(gaps) > 0.015 and max(gaps) < 0.025
    assert abs(steps[-1]["timestamp"] - looks[-1]["time_s"]) < 0.06
    assert steps[-1]["quad"]["tilt_deg"] == pytest.approx(looks[-1]["tilt_deg"], abs=0.1)
    armed = [one["board"]["status"]["armed"] for one in datagrams if "status" in one.get("board", {})]
    assert len(armed) > 10 and set(armed) == {0}


def test_times_never_go_back_and_a_new_run_begins_anew() -> None:
    clock, times = StepClock(), []
    period_us, time_us = 20_000, 0xFFFFFFFF - 700_000  # the board's clock wraps under way
    for number in range(60):
        now_us = time_us + number * 50_000
        clock.feed(65_500 + now_us // period_us - time_us // period_us & 0xFFFF, now_us & 0xFFFFFFFF)
        times += [clock.time_s(65_500 + now_us // period_us - time_us // period_us - back & 0xFFFF) for back in (1, 0)]
    known = [time_s for time_s in times[::2] if time_s is not None]
    assert len(known) == 56 and all(0.03 < after - before < 0.07 for before, after in pairwise(known))
    clock.feed(0, 5_000_000)
    assert clock.time_s(0) is None


@pytest.mark.parametrize(("text", "target"), [("9870", ("127.0.0.1", 9870)), ("plot.local:1", ("plot.local", 1))])
def test_a_target_without_a_host_is_this_machine(text: str, target: tuple[str, int]) -> None:
    assert parse_target(text) == target


@pytest.mark.parametrize("text", ["", "0", "65536", "x", "127.0.0.1", "host:", "host:-1", "9" * 30, "٣"])
def test_a_wrong_target_is_one_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="write PORT or HOST:PORT"):
        parse_target(text)


def test_an_unknown_host_is_one_sentence_and_nobody_listening_is_no_trouble() -> None:
    with pytest.raises(LinkError, match="check the address"):
        JsonStream("no..host", 9870)
    stream = JsonStream("127.0.0.1", 9)
    with Session.open(board_of()) as session:
        list(watch(session, 1.0, also=stream.feed))
    assert stream.sent > 0
    stream.close()


def test_monitor_sends_them(
    plotter: socket.socket, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board = board_of()
    monkeypatch.setattr("plumb.boards.open_link_board", lambda *_, **__: LinkBoard("memory", Session.open(board)))
    monitor = ["monitor", "--board", "memory", "--run", "live", "--seconds", "1", "--json"]
    assert front.main([*monitor, "--udp", str(plotter.getsockname()[1])]) == 0
    assert any("quad" in one for one in received(plotter))
    assert front.main([*monitor, "--udp", "nowhere"]) == 2
    assert "is no UDP port" in capsys.readouterr().err

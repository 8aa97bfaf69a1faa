"""A served board whose client asked it to wait: its time passes with the client, and without one that left or hangs."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import pytest

from plumb.boards.client_time import ClientTime
from plumb.boards.native.served import ServedNative, open_native
from plumb.boards.serve import run_paced
from plumb.contract.scenario import Plant
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.link.session import Session
from plumb.link.transports.server_endpoint import ServerEndpoint, open_endpoint
from plumb.link.transports.waiting_board import LEAD_S, MARK, MARK_EVERY_S, PATIENCE_S, READ
from plumb.systems.quad import scenarios

TURN_S = 0.001
"""The native board passes an instant by at most a turn of its loop."""
ASK = b"\rC\rO\rWAIT\r"


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def ticks(seconds: float) -> int:
    return int(seconds * TICKS_PER_S)


def test_the_board_stands_still_until_its_marks_are_answered() -> None:
    client = ClientTime(clock=Clock())
    assert client.mark(0) == b"" and client.limit(ticks(9)) == ticks(9)  # nobody asked
    assert client.received(ASK, 0) == ASK  # the board sees every line
    assert client.mark(0) == MARK and client.mark(1) == b""
    assert client.mark(ticks(MARK_EVERY_S)) == MARK
    assert client.limit(ticks(9)) == ticks(LEAD_S)
    assert client.received(READ + b"V\r", 0) == b"V\r"
    assert client.limit(ticks(9)) == ticks(LEAD_S + MARK_EVERY_S)
    assert client.received(3 * READ, 0) == b"" and client.limit(ticks(9)) == ticks(9)


@pytest.mark.parametrize("end", [b"C\r", None])
def test_time_runs_on_without_the_client(end: bytes | None) -> None:
    clock = Clock()
    client = ClientTime(clock=clock)
    for piece in (ASK[:5], ASK[5:]):
        client.received(piece, 0)
    client.mark(0)
    if end is None:
        client.gone()
    else:
        client.received(end, 0)
    assert not client.waits and client.limit(ticks(9)) == ticks(9)


def test_a_silent_client_is_waited_for_again_once_it_answers() -> None:
    clock = Clock()
    client = ClientTime(clock=clock)
    client.received(ASK, 0)
    client.mark(0)
    clock.now_s += 60.0  # the server did not run for so long
    assert client.limit(ticks(9)) == ticks(LEAD_S)
    for _ in range(round((PATIENCE_S - 0.1) / 0.005)):
        clock.now_s += 0.005
        assert client.limit(ticks(9)) == ticks(LEAD_S)
    for _ in range(40):
        clock.now_s += 0.005
        limit = client.limit(ticks(9))
    assert limit == ticks(9) and client.mark(ticks(9)) == b""
    client.received(READ, ticks(9))
    assert client.mark(ticks(9)) == MARK and client.limit(ticks(99)) == ticks(9 + LEAD_S)


def test_other_clients_send_any_byte_and_other_lines_are_no_request() -> None:
    client = ClientTime(clock=Clock())
    for data in (READ, b"WAITS\r", b" WAIT\r", b"wait\r", b"UUUUUUUUWAIT\r"):
        assert client.received(data, 0) == data and not client.waits


# ---- the whole way, over a pseudo-terminal and over TCP ----


@contextlib.contextmanager
def served(where: str) -> Iterator[tuple[ServedNative, ServerEndpoint]]:
    """The native quad, served by a thread; its plant is set up anew when a client asks."""

    def plant() -> Plant:
        return scenarios.plant(scenarios.scenario("hold", 1000, period_us=scenarios.PERIOD_US))

    board, line, ended = open_native(0, b"", "quad", plant()), open_endpoint(where), threading.Event()
    thread = threading.Thread(
        target=run_paced, args=(board, line, ended.is_set), kwargs={"set_up": lambda: board.attach(plant())}
    )
    thread.start()
    try:
        yield board, line
    finally:
        ended.set()
        thread.join()
        line.close()


@pytest.mark.parametrize("where", ["pty", "tcp:0"])
def test_an_armed_board_outlives_a_client_that_stalls_and_not_one_that_hangs(where: str) -> None:
    with served(where) as (board, line), Session.open(line.address) as session:
        assert session.fast is not None and session.fast.set_up_plant()
        session.begin("REALTIME_LIVE")
        session.arm()
        for _ in range(3):
            begin = board.now
            time.sleep(0.3)  # six times what a keep-alive may be missing
            assert board.now - begin <= ticks(LEAD_S + MARK_EVERY_S + TURN_S)
            awaited = session.listening.timeout(0.1)
            while not awaited.over:
                session.receive(0.01)
            assert session.armed and session.telemetry["STATUS"]["armed"]
        begin, begin_s = board.now, time.monotonic()
        while board.now - begin < ticks(0.1):  # on a busy machine later than after PATIENCE_S
            assert time.monotonic() - begin_s < 60.0, "the board waits for a client that hangs"
            time.sleep(0.05)
        assert time.monotonic() - begin_s > PATIENCE_S
        awaited = session.listening.timeout(0.2)
        while not awaited.over:
            session.receive(0.01)
        assert not session.telemetry["STATUS"]["armed"]


@pytest.mark.parametrize("where", ["pty", "tcp:0"])
def test_a_client_that_leaves_lets_time_run_on(where: str) -> None:
    with served(where) as (board, line):
        session = Session.open(line.address)
        session.begin("REALTIME_LIVE")
        session.arm()
        session.bus._stream._stream.close()  # type: ignore[attr-defined]  # as a process that is killed
        begin_s, begin = time.monotonic(), board.now
        while board.mcu.wires.pulse_halfus[0] != 2000 or board.now - begin < ticks(0.06):
            assert time.monotonic() - begin_s < 60.0, "never disarmed"
            time.sleep(0.01)

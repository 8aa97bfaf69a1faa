"""Silence is what a link does not bring: time in which nobody read is none."""

from __future__ import annotations

from collections import deque

import pytest

from plumb.boards import open_link_board
from plumb.errors import LinkError
from plumb.link import monitor
from plumb.link.listening import LATEST, TIME_EVERY_S, BoardWait, Listening
from plumb.link.monitor import EVERY_S, SILENCE_S, require_frames
from plumb.link.retries import REPLY_TIMEOUT_S, TRIES
from plumb.link.session import Session
from plumb.spec.protocol import Frame
from support.hand_clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


def read(listening: Listening, clock: Clock, asked_s: float, took_s: float, *, brought: bool) -> None:
    begin_s = clock()
    clock.now_s += took_s
    listening.note(asked_s, begin_s, brought)


def test_a_read_counts_for_its_wait_and_no_longer(clock: Clock) -> None:
    listening = Listening(clock)
    read(listening, clock, 0.1, 0.1, brought=False)
    read(listening, clock, 0.1, 5.0, brought=False)  # this process did not run
    clock.now_s += 60.0  # nobody read
    assert listening.quiet_s == pytest.approx(0.2)
    read(listening, clock, 0.1, 0.03, brought=True)
    assert listening.quiet_s == 0.0
    assert listening.total_s == pytest.approx(0.23)


def test_a_time_out_passes_with_reads_alone(clock: Clock) -> None:
    listening = Listening(clock)
    reply = listening.timeout(0.25)
    clock.now_s += 3.0
    assert reply.left_s == pytest.approx(0.25)
    read(listening, clock, 0.25, 0.1, brought=True)
    assert reply.left_s == pytest.approx(0.15)
    read(listening, clock, 0.15, 0.15, brought=False)
    assert reply.over
    reply.renew()
    assert reply.left_s == pytest.approx(0.25)


def test_a_host_that_never_catches_up_is_not_let_wait_for_ever(clock: Clock) -> None:
    listening = Listening(clock)
    reply = listening.timeout(0.25)
    for _ in range(LATEST * 5 - 1):  # what waits is there at once, and each read is followed by slow work
        read(listening, clock, 0.25, 0.0, brought=True)
        clock.now_s += 0.05
        assert not reply.over
    clock.now_s += 0.1
    assert reply.over


def test_a_wait_for_a_board_passes_in_its_own_time(clock: Clock) -> None:
    telemetry = {"TIME": {"time": 0xFFFFFFFF - 400_000}}
    wait = BoardWait(telemetry, clock)
    clock.now_s += 20.0  # a board simulated at 0.05 of real time; its clock begins anew in between
    telemetry["TIME"] = {"time": 600_000}
    assert not wait.over(3.0)
    telemetry["TIME"] = {"time": 2_700_000}
    assert wait.over(3.0)


def test_a_wait_for_a_board_whose_time_stands_still_ends(clock: Clock) -> None:
    wait = BoardWait({"TIME": {"time": 7}}, clock)
    clock.now_s += LATEST * 3.0 - 0.1
    assert not wait.over(3.0)
    clock.now_s += 0.1
    assert wait.over(3.0) and BoardWait({}, clock).over(0.0)


@pytest.mark.parametrize(("speed", "slowness"), [(1.0, 1.0), (0.1, 10.0), (2.0, 1.0), (0.01, LATEST)])
def test_a_board_that_is_simulated_slowly_is_given_its_own_time(clock: Clock, speed: float, slowness: float) -> None:
    listening = Listening(clock)
    assert listening.slowness == 1.0
    time_us = 0xFFFFFFFF - 120_000  # its clock begins anew in between
    for _ in range(10):
        listening.board_says(time_us & 0xFFFFFFFF)
        read(listening, clock, 0.05 / speed, 0.05 / speed, brought=True)
        time_us += 50_000
        clock.now_s += 3.0  # what this process did not listen to is no slowness of the board
    assert listening.slowness == pytest.approx(slowness)
    listening.board_says(5)  # restarted
    assert listening.slowness == 1.0


@pytest.mark.parametrize("slowness", [4.0, 15.0])
def test_a_time_out_passes_in_the_boards_own_time_while_its_frames_come(clock: Clock, slowness: float) -> None:
    """The board becomes slow when its link has long been open."""
    listening, time_us = Listening(clock), 0
    for _ in range(100):
        listening.board_says(time_us)
        read(listening, clock, TIME_EVERY_S, TIME_EVERY_S, brought=True)
        time_us += 50_000
    reply, begin_us, step_s = listening.timeout(REPLY_TIMEOUT_S), time_us, 0.01 * slowness
    begin_s, next_s = clock(), clock() + step_s
    while not reply.over:
        wait_s = min(reply.left_s, next_s - clock())
        brought = clock() + wait_s >= next_s - 1e-9
        read(listening, clock, wait_s, wait_s, brought=brought)
        if brought:  # a frame of a step, which come every 10 ms; of every fifth TIME, too
            next_s, time_us = next_s + step_s, time_us + 10_000
            if (time_us - begin_us) % 50_000 == 0:
                listening.board_says(time_us)
    assert (time_us - begin_us) * 1e-6 == pytest.approx(REPLY_TIMEOUT_S, abs=TIME_EVERY_S + 1e-9)
    assert clock() - begin_s <= LATEST * REPLY_TIMEOUT_S


def test_a_board_that_sends_nothing_is_waited_for_as_long_as_was_asked(clock: Clock) -> None:
    listening = Listening(clock)
    for time_us in range(0, 1_000_000, 50_000):
        listening.board_says(time_us)
        read(listening, clock, TIME_EVERY_S, TIME_EVERY_S, brought=True)
    reply = listening.timeout(REPLY_TIMEOUT_S)
    read(listening, clock, reply.left_s, reply.left_s, brought=False)
    assert reply.over


def test_a_board_whose_time_stands_still_is_not_waited_for_for_ever(clock: Clock) -> None:
    listening = Listening(clock)
    listening.board_says(0)
    reply, begin_s = listening.timeout(REPLY_TIMEOUT_S), clock()
    while not reply.over:
        read(listening, clock, reply.left_s, 0.01, brought=True)
    assert clock() - begin_s == pytest.approx(LATEST * REPLY_TIMEOUT_S, abs=0.02)


def test_requests_of_a_board_that_is_simulated_slowly_are_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock goes at a tenth of this computer's, and its link takes 150 ms of the board's time."""
    slowness, travel_s = 10.0, 0.15
    with open_link_board("virtual") as board:
        session = board.session
        session.begin("REALTIME_LIVE")
        board_clock, read_frames = session.clock, session.frames.read_frames
        begin_s = board_clock()
        session.clock = session.listening.clock = lambda: begin_s + slowness * (board_clock() - begin_s)
        on_their_way: deque[tuple[float, Frame]] = deque()

        def late(timeout_s: float = 0.0) -> list[Frame]:
            for frame in read_frames(timeout_s / slowness):
                on_their_way.append((board_clock() + travel_s, frame))
            come: list[Frame] = []
            while on_their_way and on_their_way[0][0] <= board_clock():
                come.append(on_their_way.popleft()[1])
            return come

        monkeypatch.setattr(session.frames, "read_frames", late)
        session.end()
        session.begin("REALTIME_LIVE")
        session.disarm()


def test_frames_of_another_host_are_no_sign_of_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_link_board("virtual") as board:
        session = board.session
        clock, waited_s = session.clock, [0.0]
        session.clock = session.listening.clock = lambda: clock() + waited_s[0]
        question = session.frame("CHALLENGE", 0, 0)

        def another_host(timeout_s: float = 0.0) -> list[Frame]:
            waited_s[0] += min(timeout_s, 0.1)
            return [question]

        monkeypatch.setattr(session.frames, "read_frames", another_host)
        with pytest.raises(LinkError, match="stopped answering"):
            session.request("DISARM", 0, 0)
        assert waited_s[0] == pytest.approx(TRIES * REPLY_TIMEOUT_S, abs=0.1)


def test_a_slow_board_falls_silent_in_its_own_time() -> None:
    with open_link_board("virtual") as board:
        session = board.session
        for time_us in (0, 100_000):
            session.listening.board_says(time_us)
            session.listening.total_s += 0.5
        session.listening.board_says(200_000)
        session.listening.quiet_s = 4.9 * SILENCE_S
        require_frames(session)
        session.listening.quiet_s = 5.1 * SILENCE_S
        with pytest.raises(LinkError, match="fell silent"):
            require_frames(session)


def test_frames_that_this_process_did_not_read_are_reported(clock: Clock) -> None:
    listening = Listening(clock)
    clock.now_s += 0.02
    read(listening, clock, 0.1, 0.1, brought=True)
    assert listening.unread_s == pytest.approx(0.02) and listening.unread_text == ""
    clock.now_s += 0.5  # between two reads
    read(listening, clock, 0.1, 0.0, brought=True)
    assert listening.unread_text == ", as this computer left the link unread for 0.50 s"
    read(listening, clock, 0.1, 1.1, brought=True)  # in a read that should have ended
    assert listening.unread_s == pytest.approx(1.0)
    read(listening, clock, 0.1, 0.1, brought=True)
    assert listening.unread_s == pytest.approx(1.0)


def test_an_arming_begins_with_a_link_that_was_read(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_link_board("virtual") as board:
        session = board.session
        session.listening.unread_s = 9.0
        session.begin("REALTIME_LIVE")
        monkeypatch.setattr(session, "execute", lambda _verb: 0)
        session.arm()
        assert session.listening.unread_s == 0.0


def stalls(session: Session, seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on this process is suspended before every read of the link, as on a machine that is too busy: the clock
    goes on, and what the board sends waits."""
    clock, away_s = session.clock, [0.0]
    session.clock = session.listening.clock = lambda: clock() + away_s[0]
    read_frames = session.frames.read_frames

    def late(timeout_s: float = 0.0) -> object:
        away_s[0] += seconds
        return read_frames(timeout_s)

    monkeypatch.setattr(session.frames, "read_frames", late)


def test_a_host_that_is_suspended_still_receives_its_board(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_link_board("virtual") as board:
        session = board.session
        stalls(session, 2.0 * SILENCE_S, monkeypatch)
        session.read_parameters()
        session.begin("REALTIME_LIVE")
        assert [look["mode"] for look in monitor.watch(session, 0.3)] == ["REALTIME"] * 3
        assert session.counters.repeated_requests == 0
        session.end()


def test_a_slow_listener_is_no_silence() -> None:
    """The work on the first frames takes longer than a board may be silent."""
    with open_link_board("virtual") as board:
        session = board.session
        clock, away_s = session.clock, [0.0]
        session.clock = session.listening.clock = lambda: clock() + away_s[0]

        def slow(_frames: object) -> None:
            away_s[0] += 2.0 * SILENCE_S

        looks = monitor.watch(session, 0.3, also=slow)
        assert next(looks)["time_s"] > 0.0


def test_a_board_that_sends_nothing_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    with open_link_board("virtual") as board:
        session = board.session
        session.receive(0.2)
        clock, waited_s = session.clock, [0.0]
        session.clock = session.listening.clock = lambda: clock() + waited_s[0]

        def nothing(timeout_s: float = 0.0) -> list[object]:
            waited_s[0] += timeout_s
            return []

        monkeypatch.setattr(session.frames, "read_frames", nothing)
        with pytest.raises(LinkError, match="the board fell silent"):
            list(monitor.watch(session, 10.0))
        assert SILENCE_S < waited_s[0] < SILENCE_S + 2 * EVERY_S

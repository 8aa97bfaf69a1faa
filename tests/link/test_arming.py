"""Arming: what it asks for, the keep-alive that holds it, and everything that ends it, at once and latched."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from plumb.errors import LinkError
from plumb.link.sample_codec import samples_text
from plumb.link.session import Session
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from support.native_board import AT_REST, BAUD_921600_NS, NewBoard, UartBoard
from support.noise import with_noise
from support.sessions import CONTROL, armed_session, listen
from support.transcripts import frame, said

SILENCE_US = 43_000
"""Without a keep-alive, at every frame length: the running frame of pulses and a turn have the rest of 50 ms."""
NEUTRAL = next(row.default for row in parameters.table() if row.name == "esc.neutral_halfus")


def test_keep_alive_holds_and_its_loss_disarms_after_50_ms_latched(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    for _ in range(100):
        session.receive(0.005)
    assert board.armed
    board.run_us(SILENCE_US - 15_000)
    assert board.armed
    board.run_us(17_000)
    assert not board.armed
    assert set(board.pulses) == {NEUTRAL}
    session.receive(0.02)  # keep-alives go out, too late
    board.run_us(1000)
    assert not board.armed
    session.receive(0.1)
    board.run_us(200_000)
    session.receive(0.1)
    assert session.telemetry["EVENTS"]["disarm_cause"] == 0x20
    session.arm()
    assert board.armed
    for _ in range(300):  # EVENTS takes turns with STATUS and COUNTERS
        session.receive(0.005)
    assert board.armed and session.telemetry["EVENTS"]["disarm_cause"] == 0
    session.close()


def without_telemetry(data: bytes) -> bytes:
    """What the board says, less all but the values for the keep-alive."""
    value = protocol()["KEEPALIVE_VALUE"].identifier
    return text_of_frames([frame for frame in SlcanParser().feed(data) if frame[0] == value])


def test_waiting_in_vain_keeps_it_alive(new_board: NewBoard) -> None:
    """Who waits for an answer that does not come answers the board's values all the same."""
    board = new_board()
    session = armed_session(board, period_us=20_000)
    board.spoil_up = without_telemetry
    session.receive(0.25)
    for _ in range(30):
        session.receive(0.25)
    assert board.armed
    session.close()


def test_pumping_keeps_it_alive_and_loses_nothing(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    session.receive(0.0)
    for _ in range(100):
        session.pump()
        board.run_us(2000)
    assert board.armed
    identifiers = [identifier for identifier, _ in session.receive(0.0)]
    assert identifiers.count(protocol()["STEP"].identifier) >= 190
    session.close()


def next_value(board: UartBoard) -> tuple[int, int]:
    """The next value that it issues, after the number of its arming; 0 for a value: none came."""
    board.received()
    for _ in range(110):
        board.turn()
        values = [
            (words["arming"], words["value"]) for name, words in said(board.received()) if name == "KEEPALIVE_VALUE"
        ]
        if values:
            return values[-1]
    return 0, 0


def test_disarming_time_to_the_turn(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    value = next_value(board)
    last = board.time_us
    board.say(frame("KEEPALIVE", *value), turns=1)
    while board.armed:
        board.turn()
    assert SILENCE_US <= board.time_us - last <= SILENCE_US + 300
    session.close()


def test_a_keep_alive_that_is_too_late_does_not_revive(new_board: NewBoard) -> None:
    """Even when it is the first thing that is seen after a long turn of the loop."""
    board = new_board()
    session = armed_session(board)
    board.write(frame("KEEPALIVE", *next_value(board)))
    board.turn(step_us=SILENCE_US)
    assert not board.armed
    session.close()


def test_a_stranger_cannot_keep_it_alive(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    for _ in range(5):
        arming, value = next_value(board)
        for wrong in (value ^ 1, value + 1 & 0xFFFFFFFF, value - 1 & 0xFFFFFFFF, 0, value ^ 1 << 31, 0xFFFFFFFF):
            board.say(frame("KEEPALIVE", arming, wrong), turns=1)
        for wrong in (0, arming - 1 & 0xFFFF, arming + 1 & 0xFFFF, arming ^ 0x8000):
            board.say(frame("KEEPALIVE", wrong, value), turns=1)
    assert not board.armed
    session.close()


def test_keep_alive_values_come_every_10_ms_only_while_armed(new_board: NewBoard) -> None:
    """Before all telemetry that waits, and none is dropped."""
    board = new_board()
    session = Session.open(board)
    session.upload(CONTROL, period_us=500, esc_period_us=2500)
    session.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"), words=range(40))
    board.run_us(100_000)
    board.baud(up_ns=BAUD_921600_NS)  # a tenth of what is asked for
    session.arm()
    received: list[tuple[int, int]] = []
    message = protocol()["KEEPALIVE_VALUE"]

    def note(frames: list[tuple[int, bytes]]) -> None:
        received.extend(
            (board.time_us, data[1] & 15) for identifier, data in frames if identifier == message.identifier
        )

    session.listener = note
    while board.time_us < 3_000_000:
        session.receive(0.001)
    times_us = [time_us for time_us, _ in received]
    assert board.armed and len(received) > 200
    assert [counter for _, counter in received] == [(received[0][1] + i) & 15 for i in range(len(received))]
    assert max(np.diff(times_us)) <= 12_000 and abs(np.mean(np.diff(times_us)) - 10_000) < 50
    session.disarm()
    received.clear()
    for _ in range(100):
        session.receive(0.001)
    assert received == []
    session.close()


def disarm_by_close(board: UartBoard, session: Session) -> None:
    board.say(b"C\r")


def disarm_by_close_and_open(board: UartBoard, session: Session) -> None:
    board.say(b"C\rO\r")  # both before the loop comes round


def disarm_by_read_only(board: UartBoard, session: Session) -> None:
    board.say(b"L\r")


def disarm_by_read_only_and_open(board: UartBoard, session: Session) -> None:
    board.say(b"L\rO\r")


def disarm_by_command(board: UartBoard, session: Session) -> None:
    session.disarm()


def disarm_by_run_end(board: UartBoard, session: Session) -> None:
    session.end()


def disarm_by_new_run(board: UartBoard, session: Session) -> None:
    session.begin("REALTIME_LIVE")


def disarm_by_fault(board: UartBoard, session: Session) -> None:
    board.sensors(faults=1)
    board.turn()


def disarm_by_other_version(board: UartBoard, session: Session) -> None:
    board.say(frame("HELLO", 99, 0))


def disarm_by_other_version_and_back(board: UartBoard, session: Session) -> None:
    board.say(frame("HELLO", 99, 0) + frame("HELLO", session.protocol.version, session.protocol.dbc_hash))


@pytest.mark.parametrize(
    "cause",
    [
        disarm_by_close, disarm_by_close_and_open, disarm_by_read_only, disarm_by_read_only_and_open, disarm_by_command,
        disarm_by_run_end,
        disarm_by_new_run, disarm_by_fault, disarm_by_other_version, disarm_by_other_version_and_back,
    ],
)  # fmt: skip
def test_what_disarms(new_board: NewBoard, cause: object) -> None:
    board = new_board()
    session = armed_session(board)
    assert callable(cause)
    cause(board, session)
    assert not board.armed
    board.turn()
    assert set(board.pulses) == {NEUTRAL}
    session.close()


def test_arming_from_a_read_only_link_is_refused(new_board: NewBoard) -> None:
    """No ARM comes through it, so what is blocked shows in STATUS alone."""
    board = new_board()
    session = Session(PlumbBus(board))
    session.connect()
    session.begin("REALTIME_LIVE")
    closed = 1 << 4
    for command, blocked in ((b"L\r", closed), (b"O\r", 0)):
        board.say(command)
        session.telemetry.clear()
        listen(session, 0.3)
        assert session.telemetry["STATUS"]["blocked"] & closed == blocked
    session.close()


@pytest.mark.parametrize("run", ["LOCKSTEP", None])
def test_arming_is_refused_with_the_reason(new_board: NewBoard, run: str | None) -> None:
    board = new_board()
    with Session.open(board) as session:
        if run:
            session.begin(run)
        with pytest.raises(LinkError, match="in lockstep nothing can be armed" if run else "no run is on"):
            session.arm()
        session.begin("REALTIME_LIVE")
        for bit in range(8):
            board.sensors(faults=1 << bit)
            with pytest.raises(LinkError, match="the board has a fault"):
                session.arm()
        board.sensors(faults=0x100)  # informs only
        session.arm()
        assert board.armed


def test_an_injected_run_is_armed_by_fresh_samples_only(new_board: NewBoard) -> None:
    board = new_board()
    session = Session.open(board)
    session.upload(CONTROL, period_us=10_000)
    session.begin("REALTIME_INJECTED")
    with pytest.raises(LinkError, match="no injected samples come"):
        session.arm()

    raw = np.array([with_noise(AT_REST[:3], step) for step in range(150)], np.int16)
    samples = samples_text(protocol(), raw, np.zeros(150))
    for step in range(100):
        board.write(samples.part(step, step + 1))
        board.run_us(10_000)
        session.receive(0.001)
        if step == 2:
            with pytest.raises(LinkError, match="it is not ready to be armed; the filter has not converged"):
                session.arm(ready_wait_s=0.0)
        if step == 80:
            session.arm()
    assert board.armed
    for _ in range(2):  # a few samples may fail
        board.run_us(10_000)
        session.receive(0.001)
    assert board.armed
    for _ in range(4):
        board.run_us(10_000)
        session.receive(0.001)
    assert not board.armed
    session.close()


def test_a_board_that_is_not_ready_is_asked_every_20_ms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each attempt takes two requests of the link."""
    session = Session.open(UartBoard())
    session.upload(CONTROL, period_us=1000)
    session.begin("REALTIME_LIVE")
    asked_s: list[float] = []
    execute = session.execute

    def noting(request: str) -> int:
        asked_s.append(session.clock())
        return execute(request)

    monkeypatch.setattr(session, "execute", noting)
    session.arm()
    pauses_s = [later - sooner for sooner, later in pairwise(asked_s)]
    assert len(pauses_s) >= 20 and min(pauses_s) >= 0.02 and max(pauses_s) < 0.03

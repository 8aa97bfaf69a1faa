"""The arm switch: arms without any host, is the dead man's handle, and keeps neutral first."""

from __future__ import annotations

import pytest

from plumb.errors import LinkError
from plumb.link.identity import BLOCKED
from plumb.link.session import Session
from plumb.spec import parameters
from support.native_board import NewBoard, UartBoard
from support.sessions import CONTROL, armed_session
from support.transcripts import frame

DEBOUNCE_US = 20_000
LOOK_US = 1000
"""Longest time between two turns of the loop: what is shorter may pass unseen."""
TRY_US = 100_000
READY_US = 700_000
"""From the begin of a run at rest until it may be armed, at most."""
READY_LIMIT_US = 5_000_000
"""How long a closed switch waits for that."""
HOLD_US = 1000 * next(row.default for row in parameters.table() if row.name == "arm_hold_ms")
NEUTRAL = {next(row.default for row in parameters.table() if row.name == "esc.neutral_halfus")}
FAULT = 1
"""A board fault that blocks."""


def ready_board(new_board: NewBoard) -> UartBoard:
    """Powered for a while with its switch open; nobody on the link."""
    board = new_board()
    board.switch(False)
    board.run_us(DEBOUNCE_US + 2 * LOOK_US)
    return board


def armed_board(new_board: NewBoard) -> UartBoard:
    board = ready_board(new_board)
    board.switch(True)
    board.run_us(DEBOUNCE_US + 2 * LOOK_US + READY_US)
    assert board.armed
    return board


@pytest.mark.slow
def test_closing_runs_the_system_live_and_arms_without_a_host(new_board: NewBoard) -> None:
    board = ready_board(new_board)
    assert board.steps == 0
    board.switch(True)
    board.run_us(DEBOUNCE_US - LOOK_US)
    assert not board.armed and board.steps == 0
    board.run_us(3 * LOOK_US)
    assert not board.armed, "the run begins; that it is at rest has to show first"
    board.run_us(READY_US)
    assert board.armed
    board.run_us(1_000_000)  # no keep-alive is asked for
    assert board.armed and board.steps > 40


def test_opening_disarms_with_the_next_turn_and_ends_the_run(new_board: NewBoard) -> None:
    board = armed_board(new_board)
    board.run_us(HOLD_US)
    assert set(board.pulses) != NEUTRAL
    board.switch(False)
    board.turn()
    assert not board.armed and set(board.pulses) == NEUTRAL
    steps = board.steps
    board.run_us(200_000)
    assert board.steps == steps


def test_a_bouncing_contact_neither_arms_nor_arms_again(new_board: NewBoard) -> None:
    board = ready_board(new_board)
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=500)  # a run that begins shows in its steps at once
    for _ in range(20):
        board.switch(True)
        board.run_us(DEBOUNCE_US // 2)
        board.switch(False)
        board.run_us(LOOK_US)
    assert not board.armed and board.steps == 0
    board = armed_board(new_board)
    board.switch(False)
    board.run_us(LOOK_US)
    board.switch(True)  # before it was open for long enough
    board.run_us(500_000)
    assert not board.armed


def test_a_switch_that_is_closed_at_the_start_has_to_be_opened_first(new_board: NewBoard) -> None:
    board = new_board()
    board.switch(True)
    board.reset()
    board.run_us(1_000_000)
    assert not board.armed and board.steps == 0
    with Session.open(board) as session:
        session.begin("REALTIME_LIVE")
        with pytest.raises(LinkError, match="the arm switch is closed"):
            session.arm()
    board.switch(False)
    board.run_us(DEBOUNCE_US + 2 * LOOK_US)
    board.switch(True)
    board.run_us(DEBOUNCE_US + 2 * LOOK_US + READY_US)
    assert board.armed


def test_a_switch_waits_for_rest_and_not_for_ever(new_board: NewBoard) -> None:
    """Closed while it moves: armed when it rests within 5 s, else not before the switch is closed again."""
    lifted = (1676, 2048, 3300, 0, 0, 0)  # 1.25 g
    for waits_us, arms in ((READY_LIMIT_US // 2, True), (READY_LIMIT_US + 100_000, False)):
        board = ready_board(new_board)
        board.sensors(lifted)
        board.switch(True)
        board.run_us(DEBOUNCE_US + waits_us, 1000)
        assert not board.armed
        board.sensors()
        board.run_us(1_500_000, 1000)
        assert board.armed == arms


def test_a_fault_prevents_arming_and_clearing_it_late_does_not_arm(new_board: NewBoard) -> None:
    board = ready_board(new_board)
    board.sensors(faults=FAULT)
    board.switch(True)
    board.run_us(DEBOUNCE_US + TRY_US + 3 * LOOK_US)
    board.sensors()
    board.run_us(1_000_000)
    assert not board.armed
    steps = board.steps
    board.run_us(100_000)
    assert board.steps == steps  # and the run is over


def test_a_fault_that_goes_at_once_does_not_matter(new_board: NewBoard) -> None:
    board = ready_board(new_board)
    board.sensors(faults=FAULT)
    board.switch(True)
    board.run_us(DEBOUNCE_US + TRY_US // 2)
    assert not board.armed
    board.sensors()
    board.turn()
    assert not board.armed
    board.run_us(READY_US)
    assert board.armed


def test_a_fault_disarms_it_latched(new_board: NewBoard) -> None:
    board = armed_board(new_board)
    board.sensors(faults=FAULT)
    board.turn()
    assert not board.armed
    board.sensors()
    board.run_us(500_000)
    assert not board.armed


def test_a_host_may_look_on_and_may_stop_it(new_board: NewBoard) -> None:
    board = armed_board(new_board)
    board.say(b"L\r")
    board.run_us(100_000)
    assert board.armed
    board.say(b"O\r" + frame("HELLO", 99, 0))  # of another version: it did not arm
    board.run_us(100_000)
    assert board.armed
    with Session.open(board) as session:
        assert board.armed
        with pytest.raises(LinkError, match="the arm switch is closed: it holds the board armed"):
            session.arm()
        assert board.armed
        session.disarm()
        assert not board.armed
        board.run_us(500_000)
        assert not board.armed


def test_a_host_that_leaves_its_run_to_the_switch_may_go(new_board: NewBoard) -> None:
    """It began the run, the switch armed: its link does not hold the board, and does not disarm it."""
    board = ready_board(new_board)
    session = Session.open(board)
    session.begin("REALTIME_LIVE")
    board.switch(True)
    board.run_us(DEBOUNCE_US + 2 * LOOK_US + READY_US)
    assert board.armed
    session.close()
    board.run_us(500_000)
    assert board.armed
    board.switch(False)
    board.turn()
    assert not board.armed


def test_the_host_is_sent_the_reason_of_the_disarm(new_board: NewBoard) -> None:
    board = armed_board(new_board)
    with Session.open(board) as session:
        board.switch(False)
        board.run_us(250_000)
        session.receive(0.1)
        assert session.telemetry["EVENTS"]["disarm_cause"] == 1 << 8
        assert BLOCKED[8] == "the arm switch was opened"


def test_closing_it_leaves_a_host_that_armed_alone(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    board.run_us(25_000)
    board.switch(True)
    for _ in range(40):
        session.receive(0.005)
    assert board.armed
    board.switch(False)
    for _ in range(40):
        session.receive(0.005)
    assert board.armed
    session.close()


@pytest.mark.parametrize("hold_ms", [0, 1, 250, 10_000])
def test_neutral_is_held_after_arming_for_the_time_of_the_parameter(new_board: NewBoard, hold_ms: int) -> None:
    board = new_board()
    session = Session.open(board)
    session.upload(CONTROL, period_us=1000, arm_hold_ms=hold_ms)
    session.begin("REALTIME_LIVE")
    session.arm()
    armed_us = board.time_us
    while set(board.pulses) == NEUTRAL:
        assert board.armed
        session.receive(0.001)
    assert hold_ms * 1000 - 2000 <= board.time_us - armed_us <= hold_ms * 1000 + 8000
    session.close()

"""The hold of a page on a board: heartbeats of the present keep it, everything else loses it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from plumb.cockpit.arming import Arming
from plumb.cockpit.hold import TAKEN_OVER_AFTER_S, TICKS_KEPT, TIMEOUT_S, Hold
from plumb.link.session import Session
from support.hand_clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_nobody_holds_a_board_at_first(clock: Clock) -> None:
    assert not Hold(clock=clock).alive(1)


def test_heartbeats_keep_the_hold_and_silence_loses_it(clock: Clock) -> None:
    hold = Hold(clock=clock)
    assert hold.take(1)
    for _ in range(20):
        tick = hold.next_tick()
        clock.now_s += 0.1
        assert hold.alive(1)
        hold.beat(1, tick)
    clock.now_s += TIMEOUT_S - 0.1
    assert hold.alive(1)
    clock.now_s += 0.01
    assert not hold.alive(1)


def test_a_heartbeat_counts_from_the_time_of_the_picture_that_it_answers(clock: Clock) -> None:
    """A page that is shown the past beats in vain."""
    hold = Hold(clock=clock)
    hold.take(1)
    old = hold.next_tick()
    clock.now_s += TIMEOUT_S + 0.01
    hold.beat(1, old)
    assert not hold.alive(1)
    hold.beat(1, hold.next_tick())
    assert hold.alive(1)


@pytest.mark.parametrize("tick", [0, 2, 12345, 0xFFFFFFFF])
def test_a_tick_that_was_never_given_counts_nothing(clock: Clock, tick: int) -> None:
    hold = Hold(clock=clock)
    hold.take(1)
    hold.next_tick()
    clock.now_s += TIMEOUT_S + 0.01
    hold.beat(1, tick)
    assert not hold.alive(1)


def test_ticks_are_forgotten(clock: Clock) -> None:
    hold = Hold(clock=clock)
    hold.take(1)
    first = hold.next_tick()
    for _ in range(TICKS_KEPT):
        hold.next_tick()
    assert len(hold._ticks_s) == TICKS_KEPT
    clock.now_s += TIMEOUT_S + 0.01
    hold.beat(1, first)
    assert not hold.alive(1)


def test_heartbeats_of_another_page_count_nothing(clock: Clock) -> None:
    hold = Hold(clock=clock)
    hold.take(1)
    clock.now_s += TIMEOUT_S + 0.01
    hold.beat(2, hold.next_tick())
    assert not hold.alive(1)


def test_a_hold_is_taken_from_a_silent_page_alone(clock: Clock) -> None:
    hold = Hold(clock=clock)
    assert hold.take(1)
    assert not hold.take(2)
    clock.now_s += TAKEN_OVER_AFTER_S - 0.01
    assert not hold.take(2)
    clock.now_s += 0.01
    assert hold.take(2)
    assert hold.held_by(2) and not hold.held_by(1)


def test_taking_again_is_no_heartbeat(clock: Clock) -> None:
    hold = Hold(clock=clock)
    hold.take(1)
    clock.now_s += TIMEOUT_S + 0.01
    assert hold.take(1)
    assert not hold.alive(1)


def test_a_released_hold_is_free_at_once(clock: Clock) -> None:
    hold = Hold(clock=clock)
    hold.take(1)
    hold.release(2)
    assert hold.alive(1)
    hold.release(1)
    assert not hold.alive(1)
    assert hold.take(2)


def test_a_page_does_not_end_the_arming_of_another_host(clock: Clock) -> None:
    """The session has no `disarm` here: a page that sent it would fail."""
    said: list[str] = []
    arming = Arming(Hold(clock=clock), said.append)
    arming.armed = True
    holding = SimpleNamespace(another=True, over="another host has armed the board")
    arming.notice(cast(Session, SimpleNamespace(holding=holding)), steps_say_armed=True)
    assert not arming.armed and said == ["not armed any more: another host has armed the board"]

"""How long `plumb bridge --seconds` runs."""

from __future__ import annotations

import time

import pytest

from plumb.bridge.bridge import Bridge
from plumb.cli.bridge import Ending
from support.hand_clock import Clock


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic", clock)
    return clock


def test_the_seconds_count_from_the_begin_of_the_first_run(clock: Clock) -> None:
    """With busy processes the way to the first run took longer than was asked for, and no step was verified."""
    ending = Ending(5.0, [], None)
    ending.bridge = bridge = Bridge("tcp:127.0.0.1:1", "tcp:127.0.0.1:2", None, (), {})
    assert not ending()
    clock.now_s += 4.9
    bridge.runs = 1
    assert not ending()
    for runs in (1, 2):  # a later run begins nothing anew
        clock.now_s += 2.4
        bridge.runs = runs
        assert not ending()
    clock.now_s += 0.3
    assert ending() and ending.passed_s == pytest.approx(5.1)


def test_without_a_run_they_count_from_the_start(clock: Clock) -> None:
    ending = Ending(5.0, [], None)
    assert ending.passed_s == 0.0 and not ending()
    clock.now_s += 5.1
    assert ending()


def test_a_signal_ends_it_at_once(clock: Clock) -> None:
    caught: list[int] = []
    ending = Ending(None, caught, None)
    clock.now_s += 1e6
    assert not ending()
    caught.append(2)
    assert ending()

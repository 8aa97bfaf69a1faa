"""The page shows how fast a simulated board runs, whichever process simulates it."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb.cockpit.speed import BoardSpeed
from support.cockpit_bench import CockpitBench

TIME_US = 50_000
"""Of the board, from one TIME to the next."""


@pytest.mark.parametrize("share", [1.0, 0.5, 0.03])
@pytest.mark.parametrize("first_us", [0, 0xFFFFFFFF - 300_000])
def test_the_speed_of_a_board_is_that_of_its_clock(share: float, first_us: int) -> None:
    """At any speed, and while its clock wraps."""
    speed, now_s = BoardSpeed(), 0.0
    for number in range(200):
        for _ in range(3):  # turns of the loop between two TIMEs
            speed.follow(first_us + number * TIME_US & 0xFFFFFFFF, now_s)
        now_s += TIME_US * 1e-6 / share
    assert speed.speed == pytest.approx(share, rel=1e-6)


def test_a_board_that_was_restarted_is_no_fast_one() -> None:
    speed = BoardSpeed()
    for number in range(100):
        speed.follow(3_000_000_000 + number * TIME_US if number < 50 else number * TIME_US, number * 0.05)
        assert speed.speed == pytest.approx(1.0)
    speed.follow(None, 100.0)
    assert speed.speed == pytest.approx(1.0)


def test_the_page_gets_the_speed_of_a_board_of_another_process(tmp_path: Path) -> None:
    bench = CockpitBench(tmp_path)
    bench.begin()
    bench.turn(2.0)
    assert bench.loop.state["speed"] == pytest.approx(1.0, abs=0.05)  # a TIME comes every 50 ms
    board_s = bench.board.session.clock
    bench.board.session.clock = lambda: 10.0 * board_s()
    bench.turn(40.0)
    bench.close()
    assert bench.loop.state["speed"] == pytest.approx(0.1, abs=0.01)

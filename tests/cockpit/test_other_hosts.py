"""A board that other hosts use, too: their runs are followed, none is taken for the cockpit's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plumb.boards.native.mcu import NativeCanBus
from plumb.link.session import Session
from support.cockpit_bench import HOLDER, NEUTRAL_HALFUS, CockpitBench, colour

STEER = 1 << 26
STEER_DEG = 5.625


def turn(bench: CockpitBench, other: Session, seconds: float) -> None:
    """Let the board's time pass for both hosts."""
    end_s = bench.board.session.clock() + seconds
    while bench.board.session.clock() < end_s:
        bench.beat()
        bench.loop.turn()
        other.pump()


def setpoint_used(bench: CockpitBench) -> object:
    return bench.loop.state["setpoint"]["used"]  # type: ignore[index]


@pytest.mark.parametrize("armed", [False, True])
def test_a_run_that_another_host_begins_is_not_taken_for_the_cockpits(tmp_path: Path, armed: bool) -> None:
    """Its steps had been compared as if they were those of the run before: a red light for a board that is well."""
    bench = CockpitBench(tmp_path)
    bench.begin()
    if armed:
        bench.arm()
        bench.ask("step_test", value=5.0, seconds=20.0)
    else:
        bench.hold.take(HOLDER)
    bench.turn(0.2)
    other = Session.over(NativeCanBus(bench.board.mcu))
    other.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    turn(bench, other, 1.0)
    assert not bench.loop.state["own_run"] and not bench.loop.state["armed_here"] and bench.loop.state["test"] is None
    assert any("another host has begun one" in text for _, text in bench.loop.notes)
    other.arm()
    other.set_setpoint(STEER)
    turn(bench, other, 1.0)
    assert colour(bench) == "off" and bench.loop.state["armed"] and other.armed
    assert setpoint_used(bench) == pytest.approx(STEER_DEG)
    said = bench.ask("arm")
    turn(bench, other, 0.1)
    assert said[0]["good"] is False and other.armed
    bench.close()


def test_the_setpoint_of_a_run_that_was_joined_is_unknown_until_the_board_says_it(tmp_path: Path) -> None:
    """0 had been shown for a board that used another one."""
    bench = CockpitBench(tmp_path)
    other = Session.over(NativeCanBus(bench.board.mcu))
    other.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    other.set_setpoint(STEER)
    for _ in range(20):
        other.receive(0.01)
    bench.begin()
    turn(bench, other, 0.5)
    assert setpoint_used(bench) is None
    other.set_setpoint(2 * STEER)
    turn(bench, other, 0.5)
    assert setpoint_used(bench) == pytest.approx(2 * STEER_DEG)
    samples = bench.loop.samples
    assert samples is not None
    _, shown = samples.series("setpoint_deg", 0.0)
    assert len(shown) < samples.rows and set(np.round(shown, 3)) == {2 * STEER_DEG}
    bench.close()


@pytest.mark.parametrize("watch", [True, False])
def test_runs_of_another_host_are_followed_and_any_page_stops_them(tmp_path: Path, watch: bool) -> None:
    bench = CockpitBench(tmp_path, watch=watch)
    other = Session.over(NativeCanBus(bench.board.mcu))
    other.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    bench.begin()
    bench.hold.take(HOLDER)

    turn(bench, other, 2.0)
    assert not bench.loop.state["own_run"] and bench.loop.samples is not None and bench.loop.samples.time_s > 1.8
    other.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    turn(bench, other, 1.0)
    assert 0.8 < bench.loop.samples.time_s < 1.2, "the rows of the second run alone"
    assert bench.loop.state["light"]["colour"] == "off"  # type: ignore[index]
    other.arm()
    turn(bench, other, 1.5)
    assert bench.loop.state["armed"] and not bench.loop.state["armed_here"]
    for verb in ("arm", "run", "set", "save", "step_test"):
        said = bench.ask(verb, name="pid.kp", value=1.0)
        turn(bench, other, 0.03)
        assert said[0]["good"] is False, verb
    bench.loop.stop()
    turn(bench, other, 0.3)
    assert not bench.loop.state["armed"] and bench.pulses() == [NEUTRAL_HALFUS] * 2
    bench.close()

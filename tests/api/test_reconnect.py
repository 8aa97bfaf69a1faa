"""plumb.connect(reconnect=...): a board that is lost and comes back, on the shipped main loop over UART and CAN, and
a served board that is killed and started again."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import plumb
from plumb.link import monitor
from plumb.link.session import Session
from support import slow_time
from support.cut_cable import Cable

PERIOD_S = 0.02


@pytest.fixture(params=["serial", "can"])
def cable(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Cable:
    return Cable(request.param).laid(monkeypatch)


def connected(on_lost: Callable[[str], None] | None = None, reconnect: bool | float = True) -> plumb.Board:
    return plumb.connect("serial:memory", reconnect=reconnect, on_lost=on_lost)


def after_the_cut(
    samples: Iterator[plumb.Sample], cable: Cable, before: int = 10, after: int = 10
) -> list[plumb.Sample]:
    """The sample before the cut, and those after it."""
    *_, last = (next(samples) for _ in range(before))
    cable.cut = True
    return [last, *(next(samples) for _ in range(after))]


def test_the_run_goes_on_and_the_steps_that_are_missing_are_counted(cable: Cable) -> None:
    reasons: list[str] = []

    def lost(reason: str) -> None:
        reasons.append(reason)
        cable.plug_in_again()

    with connected(lost) as board:
        samples = board.stream()
        last, first, *others = after_the_cut(samples, cable)
        assert first.gap is not None and first.gap.steps == first.step - last.step - 1
        assert 0.3 <= (first.step - last.step) * PERIOD_S < 0.8  # the 300 ms, greeting, and reading parameters
        assert (first.gap.changed, first.gap.image_changed, first.gap.was_armed) == ({}, False, False)
        assert [one.step - first.step for one in others] == list(range(1, 10))
        assert not any(one.gap for one in others)
        assert first.time_s == pytest.approx(first.step * PERIOD_S)
        cable.cut = True
        again = next(one for one in samples if one.gap)
        assert again.gap is not None and again.gap.steps == again.step - others[-1].step - 1
    assert reasons == [first.gap.reason] * 2 and "the cable is out" in reasons[0]
    assert cable.opened == 3


def test_a_board_that_was_armed_stays_disarmed(cable: Cable) -> None:
    with connected(lambda _: cable.plug_in_again()) as board:
        board.params["arm_hold_ms"] = 0
        board.arm()
        samples = board.stream()
        while not next(samples).armed or cable.board.pulses == (2000, 2000):
            pass
        cable.cut = True
        first = next(one for one in samples if one.gap)
        assert first.gap is not None and first.gap.was_armed and not first.armed
        later = [next(samples) for _ in range(50)]
        assert not any(one.armed for one in later) and cable.board.pulses == (2000, 2000)
        assert later[-1].health.disarm_cause
        board.arm()  # of its own will
        assert any(next(samples).armed for _ in range(10))


def test_a_restarted_board_begins_a_new_run_and_says_what_changed(cable: Cable) -> None:
    """Parameters that were not saved are gone."""

    def restart(_: str) -> None:
        cable.board.reset()
        cable.plug_in_again()

    with connected(restart) as board:
        before = board.params["pid.kp"]
        params = board.params
        params["pid.kp"] = 0.02
        _, first, *_ = after_the_cut(board.stream(), cable, before=40)
        assert first.gap is not None and first.gap.steps is None and first.step <= 1
        ((name, (was, now)),) = first.gap.changed.items()
        assert name == "pid.kp_per_deg" and was == pytest.approx(0.02, rel=1e-3) and now == before
        assert params["pid.kp"] == before
        assert params._session is board._session()  # the object goes on with the board


def test_another_board_in_its_place_is_refused(cable: Cable) -> None:
    with connected(lambda _: cable.another_board()) as board:
        with pytest.raises(plumb.LinkError, match="another board answers"):
            after_the_cut(board.stream(), cable)
        assert not cable.board.steps  # nothing was begun on it


def test_a_run_that_somebody_else_has_begun_is_left_alone(cable: Cable) -> None:
    def lost(_: str) -> None:
        cable.cut = False
        with cable.open() as other:
            other.session.begin("LOCKSTEP")
            tags.append(other.session.run_tag)

    tags: list[int] = []
    with connected(lost) as board, pytest.raises(plumb.LinkError, match="another program has begun a run"):
        after_the_cut(board.stream(), cable)
    with cable.open() as later:
        later.session.telemetry.clear()
        assert monitor.present_run(later.session) == ("LOCKSTEP", tags[0])


def test_patience_ends_with_the_last_reason(cable: Cable) -> None:
    with connected(reconnect=1e-9) as board, pytest.raises(plumb.LinkError, match=r"did not come back .* is out"):
        after_the_cut(board.stream(), cable)


def test_seconds_that_end_in_a_pause_end_the_stream(cable: Cable) -> None:
    with connected() as board:
        samples = board.stream(seconds=0.2)
        next(samples)
        cable.cut = True
        assert all(one.gap is None for one in samples)


def test_lost_again_before_a_sample_came_is_one_gap(cable: Cable) -> None:
    losses: list[str] = []

    def lost(reason: str) -> None:
        losses.append(reason)
        cable.plug_in_again()
        if len(losses) == 1:
            cable.board.reset()
            fails.append(True)

    fails: list[bool] = []
    begin = Session.begin

    def begins(self: Session, *arguments: Any, **named: Any) -> None:
        begin(self, *arguments, **named)
        if fails:
            fails.clear()
            cable.cut = True

    with connected(lost) as board, pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "begin", begins)
        board.params["pid.kp"] = 0.02
        _, first, *others = after_the_cut(board.stream(), cable)
    assert len(losses) == 2 and first.gap is not None and not any(one.gap for one in others)
    assert first.gap.steps is None and first.gap.reason == losses[0] and "pid.kp_per_deg" in first.gap.changed


def test_what_is_asked_of_a_board_that_is_away_is_link_trouble_and_not_repeated(cable: Cable) -> None:
    with connected(lambda _: cable.plug_in_again()) as board:
        samples = board.stream()
        next(samples)
        cable.cut = True
        for ask in (lambda: board.params.read(), board.disarm, board.arm):
            with pytest.raises(plumb.LinkError, match="is out"):
                ask()
        assert next(one for one in samples if one.gap)
        assert board.params["pid.kp"] != 0


def test_without_it_a_lost_board_is_an_error(cable: Cable) -> None:
    with pytest.raises(plumb.LinkError, match="is out"), plumb.connect("serial:memory") as board:
        after_the_cut(board.stream(), cable)


@pytest.mark.parametrize("wrong", [0, -1.0, "yes", None])
def test_wrong_patience_is_wrong_use(wrong: Any) -> None:
    with pytest.raises(plumb.UsageError, match="reconnect = "):
        plumb.connect("serial:memory", reconnect=wrong)


@pytest.mark.parametrize("name", ["native", "fixed"])
def test_a_board_of_this_process_is_never_lost(name: str) -> None:
    with pytest.raises(plumb.UsageError, match="is never lost"):
        plumb.connect(name, reconnect=True)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    """Starts a native board on a pseudo-terminal with a name that stays."""
    started: list[subprocess.Popen[str]] = []
    command, environment = slow_time.command(
        "virtual-board", "--port", "native", "--system", "quad", "--serial", "pty", "--symlink", str(tmp_path / "board")
    )

    def start() -> subprocess.Popen[str]:
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment))
        assert started[-1].stdout is not None and "serving" in started[-1].stdout.readline()
        return started[-1]

    yield start
    for one in started:
        one.kill()
        one.wait()


def test_a_served_board_that_is_killed_and_started_again(
    serve: Callable[[], subprocess.Popen[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow_time.slow_down(monkeypatch)
    process = serve()

    def again(_: str) -> None:
        (tmp_path / "board").unlink()
        serve()

    with plumb.connect(f"serial:{tmp_path / 'board'}", reconnect=True, on_lost=again) as board:
        samples = board.stream()
        before = [next(samples) for _ in range(5)]
        process.send_signal(signal.SIGKILL)
        process.wait()
        after = [next(samples) for _ in range(15)]
    gap = next(one for one in after if one.gap)
    assert before[-1].step >= 4 and gap.gap is not None and gap.gap.steps is None and gap.step <= 1

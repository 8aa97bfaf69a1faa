"""The loop that owns the link: comparison, arming and its three ways to end, orders and recordings."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import numpy as np
import pytest

from plumb.boards.native.board import NativeBoard
from plumb.boards.native.mcu import NativeCanBus
from plumb.cockpit import board_loop
from plumb.cockpit.board_run import ORDERS_MAX
from plumb.cockpit.hold import TIMEOUT_S
from plumb.cockpit.samples import PIECE_HEADER
from plumb.cockpit.setpoint import StepTest, setpoint_of
from plumb.errors import UsageError
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.readers import log_replay
from plumb.spec.parameter_file import by_name
from plumb.writers.recorder import Recorder
from support.cockpit_bench import HOLDER, NEUTRAL_HALFUS, CockpitBench, colour, run_number
from support.recordings import GAINS


def last_note(bench: CockpitBench) -> str:
    return bench.loop.notes[-1][1]


def test_the_light_is_green_while_every_step_equals_the_model(bench: CockpitBench) -> None:
    bench.begin()
    bench.turn(1.0)
    light = bench.loop.state["light"]
    assert isinstance(light, dict)
    assert light["colour"] == "green"
    shadow, samples = bench.loop._comparison.shadow, bench.loop.samples
    assert shadow is not None and samples is not None
    on_the_line = bench.board.mcu.wires.steps - shadow.steps
    assert 1 <= on_the_line <= 2, "the frames of the newest step, and of the one before when the host has just looked"
    waited = shadow.steps - int(light["text"].split()[0])
    assert 0 <= waited * samples.period_s <= board_loop.STATE_EVERY_S, "what the page shows is as old as its last state"


def test_a_step_that_differs_turns_the_light_red_and_disarms(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    capture = bench.loop._capture
    assert capture is not None
    feed = capture.feed

    def spoiled(frames: list[tuple[int, bytes]]) -> None:
        feed(frames)
        if capture.digest:
            capture.digest[max(capture.digest)] ^= 1

    capture.feed = spoiled  # type: ignore[method-assign]
    bench.turn(0.2)
    assert bench.loop.state["light"]["colour"] == "red"  # type: ignore[index]
    assert not bench.armed and "differs" in last_note(bench)
    said = bench.ask("arm")
    bench.turn(0.1)
    assert said[0]["good"] is False and "differs" in str(said[0]["text"])


def test_a_lost_frame_turns_the_light_amber(bench: CockpitBench) -> None:
    bench.begin()
    bench.turn(0.5)
    capture = bench.loop._capture
    assert capture is not None
    feed = capture.feed
    dropped: list[tuple[int, bytes]] = []

    def lossy(frames: list[tuple[int, bytes]]) -> None:
        keep = [frame for frame in frames if dropped or frame[0] != bench.board.session.protocol["RAW_A"].identifier]
        dropped.extend(frame for frame in frames if frame not in keep)
        feed(keep)

    capture.feed = lossy  # type: ignore[method-assign]
    bench.turn(0.5)
    assert len(dropped) == 1
    assert bench.loop.state["light"]["colour"] == "amber"  # type: ignore[index]


def test_armed_from_the_page_the_outputs_move_and_heartbeats_keep_them_so(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    for _ in range(20):
        bench.now_s += 0.1
        bench.turn(0.1)
    assert bench.armed and max(bench.pulses()) > NEUTRAL_HALFUS


def test_a_holder_that_is_silent_for_300_ms_disarms(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    bench.turn(1.5)
    bench.now_s += TIMEOUT_S
    bench.turn(0.1, beating=False)
    assert bench.armed, "300 ms of silence are allowed"
    bench.now_s += 0.001
    bench.turn(0.05, beating=False)
    assert bench.pulses() == [NEUTRAL_HALFUS] * 2 and not bench.armed
    assert "fell silent" in last_note(bench)
    bench.turn(1.0)
    assert not bench.armed, "it stays disarmed when the page comes back"


def test_without_consent_the_board_disarms_itself_whatever_the_loop_does(bench: CockpitBench) -> None:
    """The loop may hang in a transfer: keep-alive values are not answered any more."""
    bench.begin()
    bench.arm()
    bench.turn(1.5)
    bench.now_s += TIMEOUT_S + 0.001
    end_s = bench.board.session.clock() + 0.06
    while bench.board.session.clock() < end_s:
        bench.board.session.receive(0.005)
    assert bench.pulses() == [NEUTRAL_HALFUS] * 2


def test_a_stop_disarms_and_ends_what_is_queued(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    queued = bench.ask("step_test", value=5.0, seconds=2.0)
    bench.loop.stop()
    assert not bench.loop._arming.consent()
    bench.turn(0.15)
    assert queued == [{"good": False, "text": "stopped"}]
    assert not bench.armed and bench.loop._arming.consent()


def test_a_stop_ends_the_wait_of_arming(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(0.05)  # not ready yet: at rest and converged takes 0.6 s
    said = bench.ask("arm")
    bench.turn(0.1)
    assert not said and bench.loop.state["arming"]
    bench.loop.stop()
    bench.turn(1.5)
    assert said[0]["good"] is False and not bench.armed


def test_another_page_takes_neither_an_armed_board_over_nor_its_arming(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(0.05)
    said = bench.ask("arm")
    bench.turn(0.1)
    bench.hold.release(HOLDER)
    bench.hold.take(2)
    bench.turn(1.0)
    assert said[0]["good"] is False and not bench.armed
    bench.hold.release(2)
    bench.arm()
    bench.hold.release(HOLDER)
    bench.hold.take(2)
    bench.hold.beat(2, bench.hold.next_tick())
    bench.turn(0.2)
    assert not bench.armed


def test_a_silent_page_does_not_arm(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(1.0)
    said = bench.ask("arm")
    bench.now_s += TIMEOUT_S + 0.001
    bench.turn(0.2, beating=False)
    assert said[0]["good"] is False and not bench.armed


@pytest.mark.parametrize("verb", ["arm", "run", "record", "set", "setpoint", "step_test", "parameters", "save"])
def test_a_page_that_does_not_hold_the_board_orders_nothing(bench: CockpitBench, verb: str) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    said = bench.ask(verb, page=2)
    bench.turn(0.1)
    assert said == [{"good": False, "text": "this page does not hold the board"}]


@pytest.mark.parametrize("how", ["stop", "page lost", "page gone", "board alone"])
def test_whatever_ends_an_arming_ends_its_setpoint_on_the_board(bench: CockpitBench, how: str) -> None:
    bench.begin()
    bench.arm()
    bench.ask("step_test", value=5.0, seconds=5.0)
    bench.turn(0.5)
    assert setpoint_used(bench) == pytest.approx(5.0, abs=1e-6)
    if how == "stop":
        bench.loop.stop()
    elif how == "page lost":
        bench.now_s += TIMEOUT_S + 0.001
    elif how == "page gone":
        bench.hold.release(HOLDER)
    else:
        bench.board.session.consent = lambda: False
    bench.turn(0.4, beating=False)
    assert not bench.armed and bench.loop.state["test"] is None
    assert setpoint_used(bench) == 0.0
    bench.board.session.consent = bench.loop._arming.consent
    assert bench.hold.take(HOLDER) and bench.answer("arm") == {"good": True, "text": "armed"}
    bench.turn(0.5)
    assert bench.armed and setpoint_used(bench) == 0.0, "no setpoint comes back with the next arming"


@pytest.mark.parametrize("unread_s", [0.0, 0.5])
def test_a_cockpit_that_was_starved_says_so(bench: CockpitBench, unread_s: float) -> None:
    bench.begin()
    bench.arm()
    bench.board.session.listening.unread_s = unread_s
    bench.board.mcu.wires.faults = 1
    bench.turn(0.2)
    starved = ", as this computer left the link unread for 0.50 s" if unread_s else ""
    assert last_note(bench) == f"the board disarmed itself{starved}; Health says why"


def setpoint_used(bench: CockpitBench) -> float:
    """What the page shows: the board's own."""
    return bench.loop.state["setpoint"]["used"]  # type: ignore[index, no-any-return]


def test_a_step_test_moves_the_setpoint_and_says_what_came_of_it(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    said = bench.ask("step_test", value=5.0, seconds=1.0)
    bench.turn(0.5)
    assert said == [{"good": True, "text": ""}] and bench.loop.state["test"]
    bench.turn(1.0)
    assert bench.loop.state["test"] is None and last_note(bench).startswith("step test of 5 deg: rise time")
    for value, seconds in ((90.0, 1.0), (5.0, 0.1), (5.0, 1000.0), (0.0, 1.0)):
        said = bench.ask("step_test", value=value, seconds=seconds)
        bench.turn(0.03)
        assert said[0]["good"] is False


def test_every_step_of_a_recording_is_there_while_no_page_reads(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(0.2)
    bench.ask("record", on=True)
    bench.turn(2.0)
    assert bench.loop.state["recording"]["on"]  # type: ignore[index]
    bench.ask("record", on=False)
    path = bench.recorded()
    (recorded,) = log_replay.runs_of(log_replay.open_log(path))
    # Of 2 s at 50 Hz: the recording begins and ends with a turn of the loop.
    assert recorded.run.steps > 90 and recorded.run.incomplete == 0
    done = log_replay.reproduce(recorded, NativeBoard(), "native", None, None)
    assert done.verdict == "pass" and done.compared == recorded.run.steps  # from the beginning of the run on
    text = path.with_suffix(".html").read_text(encoding="utf-8")
    assert '<span class="verdict pass">' in text and re.search(r"While it ran: \d+ steps equal the model", text)


def test_a_recording_has_the_parameters_of_each_of_its_runs(bench: CockpitBench) -> None:
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(0.2)
    bench.ask("record", on=True)
    bench.turn(0.5)
    bench.ask("set", name="kalman.q_angle", value=0.004)
    bench.turn(0.5)
    bench.ask("record", on=False)
    path = bench.recorded()
    first, second = log_replay.runs_of(log_replay.open_log(path))
    changed = [name for name, value in first.used.table.items() if second.used.table[name] != value]
    assert "kalman.qa_lo" in changed
    text = path.with_suffix(".html").read_text(encoding="utf-8")
    assert '<span class="verdict pass">' in text and "No step was compared" not in text


@pytest.mark.parametrize("staged_seen", [True, False])
def test_the_light_stays_green_and_a_recording_replays_across_a_change_of_gains(
    bench: CockpitBench, staged_seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Committed by another program during the run, before the recording begins. staged_seen: over this link; else
    the loop learns of it by PARAM_USED alone, and reads the table."""
    bench.begin()
    bench.hold.take(HOLDER)
    bench.turn(0.3)
    session, feed = bench.board.session, bench.loop._feed
    staged = session.protocol["PARAM_STAGED"].identifier
    session.listener = feed if staged_seen else lambda frames: feed([frame for frame in frames if frame[0] != staged])
    table = by_name(session.read_parameters())
    parameter_table.commit(session, {**table, **GAINS})
    session.listener = feed
    bench.turn(0.3)
    bench.ask("record", on=True)
    bench.turn(1.0)
    assert bench.loop.state["light"]["colour"] == "green"  # type: ignore[index]
    (change,) = bench.loop._comparison.shadow.changes  # type: ignore[union-attr]
    bench.ask("record", on=False)
    path = bench.recorded()
    (recorded,) = log_replay.runs_of(log_replay.open_log(path))
    done = log_replay.reproduce(recorded, NativeBoard(), "native", None, None)
    assert done.verdict == "pass" and done.compared == recorded.run.steps > change.step + 50
    assert [one.step for one in done.run.changes] == [change.step]


def test_a_recording_that_cannot_be_written_ends_and_the_run_goes_on(
    bench: CockpitBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.begin()
    bench.arm()
    bench.ask("record", on=True)
    bench.turn(0.1)
    writer = bench.loop.recording._writer

    def full(*_: object) -> None:
        raise UsageError("no space left")

    monkeypatch.setattr(Recorder, "add", full)
    bench.turn(0.1)
    assert writer is not None
    writer.join()
    bench.turn(0.3)
    assert bench.armed and bench.loop.state["recording"] == {"on": False}
    assert any("no space left" in text for _, text in bench.loop.notes)


def test_what_a_recording_writes_does_not_hold_the_loop(bench: CockpitBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The beginning of a long run takes seconds to write; an armed board waits 50 ms for a keep-alive."""
    threads = list[int]()
    add = Recorder.add

    def noted(recorder: Recorder, *batch: object) -> None:
        threads.append(threading.get_ident())
        add(recorder, *batch)  # type: ignore[arg-type]

    monkeypatch.setattr(Recorder, "add", noted)
    bench.begin()
    bench.arm()
    bench.turn(1.0)
    before_s = bench.board.session.clock()
    bench.loop.recording.start(bench.board, bench.loop._words)
    assert bench.board.session.clock() == before_s, "nothing was waited for"
    bench.turn(0.5)
    bench.loop.recording.stop()
    bench.recorded()
    assert bench.armed and len(threads) > 50 and threading.get_ident() not in threads


def test_a_board_that_is_restarted_ends_its_run_and_nothing_begins_by_itself(tmp_path: Path) -> None:
    bench = CockpitBench(tmp_path)
    other = Session.over(NativeCanBus(bench.board.mcu))
    bench.begin()
    bench.arm()
    other.end()  # to the cockpit it looks like a restart: an idle board
    bench.turn(1.0)
    assert not bench.loop.state["armed_here"] and not bench.loop.state["own_run"]
    assert "the run ended" in last_note(bench) and bench.pulses() == [NEUTRAL_HALFUS] * 2
    runs = run_number(bench)
    bench.turn(1.0)
    assert run_number(bench) == runs
    assert "New run" not in str(bench.answer("run")["text"])
    bench.turn(1.0)
    assert bench.loop.state["own_run"] and colour(bench) == "green"
    bench.close()


def test_orders_in_a_flood_are_refused_and_the_loop_goes_on(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    flood = [bench.ask("describe", name="pid.kp") for _ in range(500)]
    refused = sum(bool(said) for said in flood)
    assert refused == 500 - ORDERS_MAX
    bench.turn(1.0)
    assert bench.armed
    assert bench.answer("setpoint", value=1.0)["good"]


def test_a_step_to_where_the_signal_is_has_no_result(bench: CockpitBench) -> None:
    bench.begin()
    bench.arm()
    said = bench.answer("step_test", value=0.31, seconds=1.0)
    assert said["good"]
    bench.turn(1.5)
    with pytest.raises(UsageError, match="too small"):
        test = StepTest(setpoint_of("quad"), 1.0, 1.0)  # type: ignore[arg-type]
        samples = bench.loop.samples
        assert samples is not None
        monkey = pytest.MonkeyPatch()
        with monkey.context() as patch:
            patch.setattr(samples, "series", lambda *_: ([0.0], [0.9]))
            test.begin(bench.board.session, samples)


def test_rows_have_every_signal_of_the_steps(bench: CockpitBench) -> None:
    bench.begin()
    bench.turn(1.0)
    samples = bench.loop.samples
    assert samples is not None
    piece, end = samples.piece(0, tick=5)
    tick, run, first, rows, columns, missed = PIECE_HEADER.unpack_from(piece)
    assert (tick, run, first, missed) == (5, 1, 0, 0) and rows == end == samples.rows
    times = np.frombuffer(piece, "<f8", rows, PIECE_HEADER.size)
    values = np.frombuffer(piece, "<f4", rows * columns, PIECE_HEADER.size + 8 * rows).reshape(rows, columns)
    assert np.allclose(times, samples.period_s * np.arange(rows)) and np.isfinite(values).all()
    assert {"tilt_deg", "rate_dps", "raw_gyro"} <= {column.name for column in samples.columns}


def test_the_loop_leaves_the_board_disarmed_and_idle(bench: CockpitBench) -> None:
    turns = 0

    def stopped() -> bool:
        nonlocal turns
        turns += 1
        bench.beat()
        if turns == 150:
            bench.hold.take(HOLDER)
        if turns == 160:
            bench.ask("arm")
        return turns > 300 and bench.armed

    bench.loop.run(stopped)
    with Session.open(bench.board.mcu.uart) as session:
        while "STATUS" not in session.telemetry:
            session.receive(0.2)
        assert session.telemetry["STATUS"]["mode"] == session.telemetry["STATUS"]["armed"] == 0
    assert bench.pulses() == [NEUTRAL_HALFUS] * 2


def test_a_lost_link_is_opened_again_and_nothing_is_armed_by_itself(
    bench: CockpitBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(board_loop, "REOPEN_S", 0.0)
    first, said = bench.board, list[object]()
    bench.hold.take(HOLDER)

    def stopped() -> bool:
        bench.beat()
        now_s = bench.board.session.clock()
        if bench.board is not first:
            return now_s > 2.0 and bench.loop.state["light"]["colour"] == "green"  # type: ignore[index]
        if not said and now_s > 1.0:
            said.extend([bench.ask("arm"), bench.ask("record", on=True)])
        if bench.loop.state.get("armed_here") and now_s > 2.0:
            first.mcu.power_off()
        assert now_s < 10.0
        return False

    bench.loop.run(stopped)
    notes = [text for _, text in bench.loop.notes]
    assert any(text.startswith("the link was lost") for text in notes) and "the board answers again" in notes
    assert notes.count("armed by the page") == 1 and not bench.armed
    assert any(text.startswith("recorded ") for text in notes)

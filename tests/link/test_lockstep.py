"""Runs: every digest arrives in lockstep whatever the line does, and a live run knows from where on it does not."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest

from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.link.lockstep import Lockstep
from plumb.link.realtime import Capture, unwrap
from plumb.link.sample_codec import samples_text
from plumb.link.session import Session
from plumb.link.transports.slcan import SlcanParser
from plumb.spec import declarations
from plumb.spec.protocol import protocol
from plumb.systems.turntable import scenarios as turntable
from support.native_board import BAUD_921600_NS, NewBoard, UartBoard
from support.sessions import CONTROL, BadLine
from support.transcripts import begin, frame, said


def input_of(steps: int, seed: int, channels: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    raw = rng.integers(-32768, 32768, (steps, channels)).astype(np.int16)
    raw[rng.random(steps) < 0.5, 3:] = 0
    hold = rng.integers(0, 5, steps).cumsum() // 4
    return raw, rng.integers(-(1 << 31), 1 << 31, steps)[hold].astype(np.int32)


def digests_of(raw: np.ndarray, setpoint: np.ndarray) -> np.ndarray:
    """On the native port, over a line without trouble."""
    with Session.open(UartBoard()) as session:
        return Lockstep(session).run(raw, setpoint)


def test_batches_single_steps_and_words_agree(new_board: NewBoard) -> None:
    raw, setpoint = input_of(300, 1, channels=6)
    whole = digests_of(raw, setpoint)
    with Session.open(new_board()) as session:
        run = Lockstep(
            session,
            frames=("QUAD_ANGLE", "QUAD_BIAS", "QUAD_RATE", "QUAD_MEASURED", "QUAD_COMMAND"),
            words=tuple(range(40)),
        )
        for step in range(40):
            reply = run.exchange(tuple(int(v) for v in raw[step]), int(setpoint[step]))
            record = struct.pack("<40I", *(reply.words[i] for i in range(40)))
            assert zlib.crc32(record) == reply.digest == whole[step]
            names = protocol()["WORD"].choices["index"]
            words = {names[i].removeprefix("quad."): word for i, word in reply.words.items()}
            assert reply.values["tilt"] & 0xFFFFFFFF == words["tilt_turn_q32"]
            assert reply.values["rate"] & 0xFFFFFFFF == words["rate_corrected_turnps_q28"]
            assert reply.values["tilt_measured"] & 0xFFFFFFFF == words["tilt_measured_turn_q32"]
            assert reply.values["command"] & 0xFFFFFFFF == words["command_q22"]
            assert reply.values["bias"] & 0xFFFFFFFF == words["bias_turnps_q28"]
            assert (reply.values["pulse_0"], reply.values["pulse_1"]) == (
                words["pulse_halfus_0"], words["pulse_halfus_1"],
            )  # fmt: skip
            assert struct.unpack_from("<6i", record) == tuple(raw[step])
            assert words["setpoint_turn_q32"] == int(setpoint[step]) & 0xFFFFFFFF
        session.select()
        assert np.array_equal(run.run(raw[40:], setpoint[40:]), whole[40:])


def test_a_run_resets_state_step_and_digest(new_board: NewBoard) -> None:
    raw, setpoint = input_of(100, 2)
    with Session.open(new_board()) as session:
        first = Lockstep(session).run(raw, setpoint)
        assert np.array_equal(Lockstep(session).run(raw, setpoint), first)
        assert session.end() == 100
        run = Lockstep(session)
        again = [run.run(raw, setpoint), run.run(raw, np.zeros(100))]
        both = digests_of(np.concatenate([raw, raw]), np.concatenate([setpoint, np.zeros(100, np.int32)]))
        assert np.array_equal(np.concatenate(again), both)
        Lockstep(session).run(raw, np.full(100, 12345))
        level = np.zeros(100)  # a setpoint of 0 is not said: it is what a run begins with
        assert np.array_equal(Lockstep(session).run(raw, level), digests_of(raw, level))


def test_step_numbers_go_round(new_board: NewBoard) -> None:
    raw, setpoint = input_of(66_000, 3)
    whole = digests_of(raw, setpoint)
    with Session.open(new_board()) as session:
        run = Lockstep(session)
        halves = [run.run(raw[part], setpoint[part]) for part in (slice(0, 65_530), slice(65_530, None))]
        assert np.array_equal(np.concatenate(halves), whole)
        assert session.end() == 66_000 % 65_536


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("way", ["down", "up", "both"])
def test_every_digest_arrives_over_a_bad_line(new_board: NewBoard, seed: int, way: str) -> None:
    raw, setpoint = input_of(200, seed, channels=6)
    board = new_board()
    with Session.open(board) as session:
        run = Lockstep(session)
        if way != "up":
            board.spoil_down = BadLine(seed, 0.002)
        if way != "down":
            board.spoil_up = BadLine(seed + 100, 0.002)
        digests = run.run(raw, setpoint)
        board.spoil_down = board.spoil_up = bytes
        assert board.steps == 200
        # A loss shows in what comes next; only at the end of a run somebody has to wait for it.
        assert board.time_us < (350_000 if way != "both" else 1_500_000)
    assert np.array_equal(digests, digests_of(raw, setpoint))


def test_lost_words_are_an_error_not_a_guess(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        run = Lockstep(session, frames=("QUAD_ANGLE",))
        run.exchange((1, 2, 3))
        board.spoil_up = lambda data: data.replace(b"t304", b"t305")
        with pytest.raises(LinkError, match="words of step 1 were lost"):
            run.exchange((1, 2, 3))


def test_words_that_come_late_are_waited_for(new_board: NewBoard) -> None:
    """Half a second after their step."""
    board, held = new_board(), bytearray()
    with Session.open(board) as session:
        run = Lockstep(session, words=(3,))
        word, late_us = f"t{protocol()['WORD'].identifier:03X}".encode(), board.time_us + 500_000

        def hold(data: bytes) -> bytes:
            lines = data.splitlines(keepends=True)
            held.extend(b"".join(line for line in lines if line.startswith(word)))
            rest = b"".join(line for line in lines if not line.startswith(word))
            if board.time_us > late_us:
                rest, held[:] = rest + held, b""
            return rest

        board.spoil_up = hold
        assert set(run.exchange((1, 2, 3)).words) == {3}
        assert board.time_us > late_us


def test_a_busy_host_handles_received_frames_before_it_times_out(new_board: NewBoard) -> None:
    """Its clock is an hour on when it comes back."""
    board = new_board()
    with Session.open(board) as session:
        run = Lockstep(session, words=(3,))
        receive, away_s = session.receive, [0.0]
        session.clock = lambda: board.clock_s() + away_s[0]

        def one_by_one(timeout_s: float) -> list[tuple[int, bytes]]:
            if not waiting:
                waiting.extend(receive(timeout_s))
            away_s[0] += 3600.0
            return [waiting.pop(0)] if waiting else []

        waiting: list[tuple[int, bytes]] = []
        session.receive = one_by_one  # type: ignore[method-assign]
        assert set(run.exchange((1, 2, 3)).words) == {3}


def test_sixteen_in_flight_and_no_more(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.begin("LOCKSTEP", words=range(40))
        samples = samples_text(protocol(), np.zeros((25, 3), np.int16), np.zeros(25))
        board.baud(up_ns=BAUD_921600_NS)  # a step waits until the words of the last one are out
        answers = said(board.say(samples.text, turns=4000))
        nack = next(words for name, words in answers if name == "NACK")
        assert protocol()["NACK"].choice("reason", nack["reason"]) == "QUEUE_FULL"
        assert [words["step"] for name, words in answers if name == "STEP"] == list(range(nack["detail"]))


def test_a_gap_is_reported_once_with_the_step_that_is_missing(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.begin("LOCKSTEP")
        samples = samples_text(protocol(), np.zeros((8, 3), np.int16), np.zeros(8))
        answers = said(board.say(samples.part(0, 2) + samples.part(3, 8), turns=20))
        assert [(words["reason"], words["detail"]) for name, words in answers if name == "NACK"] == [(11, 2)]
        answers = said(board.say(samples.part(1, 8), turns=20))  # one too early: answered again, not run again
        assert [words["step"] for name, words in answers if name == "STEP"] == list(range(1, 8))
        assert board.steps == 8


def test_a_second_half_from_64_steps_ago_is_not_taken(new_board: NewBoard) -> None:
    """SAMPLE_B carries six bits of its step: one that was used must not serve the step where they come round."""
    board = new_board()
    with Session.open(board) as session:
        session.begin("LOCKSTEP")
        raw = np.zeros((65, 6), np.int16)
        raw[[0, 64], 3] = 7
        samples = samples_text(protocol(), raw, np.zeros(65))
        for step in range(64):
            board.say(samples.part(step, step + 1))
        whole = samples.part(64, 65)
        answers = said(board.say(whole[len(whole) // 2 :]))  # SAMPLE_A alone
        assert [(name, words["detail"]) for name, words in answers] == [("NACK", 64)]
        assert [name for name, _ in said(board.say(whole))] == ["STEP"]


def test_samples_without_a_run_are_refused(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board):
        sample = samples_text(protocol(), np.zeros((1, 3), np.int16), np.ones(1))
        reasons = [words["reason"] for name, words in said(board.say(sample.text)) if name == "NACK"]
        assert reasons == [10, 10]  # NO_RUN, for SETPOINT and for SAMPLE_A


def test_samples_of_a_run_on_the_boards_own_sensors_are_refused(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.begin("REALTIME_LIVE")
        sample = samples_text(protocol(), np.zeros((1, 3), np.int16), np.zeros(1))
        refused = [words for name, words in said(board.say(sample.text)) if name == "NACK"]
        assert [words["reason"] for words in refused if words["request"] == protocol()["SAMPLE_A"].identifier] == [10]


@pytest.mark.parametrize(
    ("raw", "setpoint"),
    [(np.zeros((3, 2)), np.zeros(3)), (np.zeros((3, 3)), np.zeros(2)), (np.full((1, 3), 40000), [0])],
)
def test_samples_of_the_wrong_shape_are_refused(raw: np.ndarray, setpoint: np.ndarray) -> None:
    with pytest.raises(UsageError):
        samples_text(protocol(), raw, setpoint)


def test_selection_is_checked(new_board: NewBoard) -> None:
    with Session.open(new_board()) as session:
        with pytest.raises(UsageError, match="no frame 'ANGEL'"):
            session.select(frames=("ANGEL",))
        with pytest.raises(UsageError, match="no word 40"):
            session.select(words=(40,))


# ---- real time ----


def live(board: UartBoard, run: str = "REALTIME_LIVE") -> tuple[Session, Capture]:
    session = Session.open(board)
    session.upload(CONTROL, period_us=1000)
    capture = Capture(session, raw_frames=("RAW_A",))
    session.listener = capture.feed
    session.begin(run, frames=("RAW_A", "QUAD_ANGLE", "QUAD_BIAS"))
    return session, capture


def test_a_live_run_can_be_run_again(new_board: NewBoard) -> None:
    board = new_board()
    board.baud(down_ns=10_000, up_ns=10_000)
    session, capture = live(board)
    rng = np.random.default_rng(4)
    for setpoint in (5, -(1 << 31), 77):
        for _ in range(30):
            board.sensors((*(int(v) for v in rng.integers(0, 4096, 3)), 0, 0, 0))
            board.run_us(1000)
        capture.set_setpoint(setpoint)
    capture.collect(150)
    assert capture.unverified_from(150) is None
    assert len(capture.setpoints.changes) == 4
    assert np.array_equal(capture.digests(150), digests_of(capture.raw_counts(150), capture.setpoints.of_steps(150)))
    steps = [step for step, _ in capture.time_us]
    assert len(steps) >= 2
    assert np.all(np.abs(np.diff([time for _, time in capture.time_us]) - 50_000) == 0)
    session.close()


def test_steps_of_the_run_before_are_not_taken_for_this_one(new_board: NewBoard) -> None:
    board = new_board()
    session, first = live(board)
    first.collect(37)
    board.run_us(50_000)
    session.listener = None
    second = Capture(session, raw_frames=("RAW_A",))
    session.listener = second.feed
    session.begin("REALTIME_LIVE", frames=("RAW_A",))
    second.collect(50)
    assert sorted(second.digest) == list(range(second.steps))
    assert second.unverified_from(50) is None
    assert np.array_equal(second.digests(50), digests_of(second.raw_counts(50), second.setpoints.of_steps(50)))
    session.close()


@pytest.mark.parametrize("lost", ["RAW_A", "STEP"])
def test_a_lost_count_or_digest_is_noticed(new_board: NewBoard, lost: str) -> None:
    board = new_board()
    session, capture = live(board)
    capture.collect(20)
    name = b"t%03X" % protocol()[lost].identifier
    board.spoil_up = lambda data: data.replace(name, b"t7EE")
    seen = capture.steps
    capture.session.receive(0.01)
    board.spoil_up = bytes
    capture.collect(60)
    first = capture.unverified_from(60)
    assert first is not None
    assert seen <= first <= seen + 12
    assert capture.unverified_from(20) is None
    session.close()


@pytest.mark.parametrize(
    ("last", "low", "bits", "step"),
    [(70, 7, 6, 71), (70, 5, 6, 69), (63, 0, 6, 64), (64, 63, 6, 63), (65535, 0, 16, 65536), (65540, 65535, 16, 65535)],
)
def test_a_short_number_is_the_nearest_step(last: int, low: int, bits: int, step: int) -> None:
    """A frame may belong to the step before the last STEP, too."""
    assert unwrap(last, low, bits) == step


def test_a_setpoint_without_confirmation_is_in_doubt(new_board: NewBoard) -> None:
    board = new_board()
    session, capture = live(board)
    capture.collect(20)
    once = iter([True])
    board.spoil_up = lambda data: data.replace(b"t1148", b"t1149") if b"t1148" in data and next(once, False) else data
    capture.set_setpoint(1000)
    capture.collect(capture.steps + 5)
    first = capture.unverified_from(capture.steps)
    assert first is not None
    assert first >= 20
    session.close()


def test_injected_in_real_time_holds_the_last_sample_and_counts(new_board: NewBoard) -> None:
    board = new_board()
    session, capture = live(board, "REALTIME_INJECTED")
    samples = samples_text(protocol(), np.arange(30, dtype=np.int16).reshape(10, 3), np.zeros(10))
    board.write(samples.part(0, 5) + samples.part(6, 10))
    capture.collect(20)
    raw = capture.raw_counts(20)
    expected = [[3 * k, 3 * k + 1, 3 * k + 2] for k in (0, 1, 2, 3, 4, 6, 7, 8, 9)]
    start = int(np.argmax(raw[:, 1] > 0))
    assert raw[start : start + 9, :3].tolist() == expected
    assert np.all(raw[start + 9 :, :3] == expected[-1])
    board.run_us(200_000)
    session.receive(0.01)
    assert session.telemetry["EVENTS"]["starved"] > 5
    assert session.telemetry["COUNTERS"]["lost"] == 1
    again = Capture(session, raw_frames=("RAW_A",))
    session.listener = again.feed
    session.begin("REALTIME_INJECTED", frames=("RAW_A",))
    again.collect(3)
    assert not again.raw_counts(3).any()  # what the last run held is not held for this one
    session.close()


def test_the_turntable_gets_the_mark_of_a_missing_sample(new_board: NewBoard) -> None:
    """A sample of the gyro that is held would be one more sample of the gyro."""
    board = new_board()
    session = Session.open(board)
    params = quantise(turntable.DATA)
    session.upload(params.words(), period_us=turntable.PERIOD_US)
    capture = Capture(session)
    session.begin("REALTIME_INJECTED", frames=("RAW_A", "RAW_B"))
    session.listener = capture.feed
    board.write(samples_text(protocol(), np.arange(1, 61, dtype=np.int16).reshape(10, 6), np.zeros(10)).part(0, 10))
    capture.collect(30)
    raw = capture.raw_counts(30)[:, : declarations.system("turntable").inputs]
    start = int(np.argmax(raw[:, 1] > 0))
    assert raw[start : start + 10].tolist() == np.arange(1, 61).reshape(10, 6).tolist()
    assert np.all(raw[:start] == turntable.NO_SAMPLE) and np.all(raw[start + 10 :] == turntable.NO_SAMPLE)
    session.close()


def test_in_real_time_the_first_sample_says_where_the_numbers_are(new_board: NewBoard) -> None:
    """A sensor board was running before: nothing is missing because it is at number 37."""
    board = new_board()
    session, capture = live(board, "REALTIME_INJECTED")
    board.write(samples_text(protocol(), np.ones((5, 3), np.int16), np.zeros(5), step=37).text)
    capture.collect(10)
    board.write(samples_text(protocol(), np.ones((5, 3), np.int16), np.zeros(5), step=44).text)
    board.run_us(200_000)
    session.receive(0.01)
    assert session.telemetry["COUNTERS"]["lost"] == 2
    session.close()


def test_replies_name_their_request(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.protocol = replace(session.protocol)
        begin(board, "LOCKSTEP")
        acks = [words for name, words in said(board.say(frame("RUN_END", 0, 0, counter=9))) if name == "ACK"]
        assert acks == [{"request_counter": 9, "request": protocol()["RUN_END"].identifier, "detail": 0}]


def test_parser_of_the_answers_counts_every_cr(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.begin("LOCKSTEP")
        samples = samples_text(protocol(), np.zeros((5, 3), np.int16), np.zeros(5))
        parser = SlcanParser()
        parser.feed(board.say(samples.text, turns=10))
        assert (parser.accepted, parser.refused) == (5, 0)

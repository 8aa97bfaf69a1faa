"""The conversation: handshake, parameters, telemetry, over a good line and over a bad one."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import can
import numpy as np
import pytest

from plumb import systems
from plumb.boards.native.mcu import NEVER
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.link.identity import NackError
from plumb.link.lockstep import Lockstep
from plumb.link.nonces import execute_with_nonce
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan import text_of_frames
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from plumb.spec.protocol import Frame, crc8, protocol
from support.native_board import BAUD_921600_NS, NewBoard, UartBoard
from support.sessions import CONTROL, BadLine, armed_session
from support.transcripts import begin, frame, said


def changed(name: str, value: int) -> list[int]:
    words = list(CONTROL)
    words[[row.name for row in parameters.table()].index(name)] = value
    return words


# ---- handshake ----


def test_connect_identifies_the_board() -> None:
    with Session.open(UartBoard(seed=7)) as session:
        identity = session.identity
        assert identity is not None
        assert identity.mismatch is None
        assert identity.git_hash == "0123456789abcdef"
        assert identity.unique_id == "000000072222222233333333"


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        ({"version": protocol().version + 1}, "update the board's image"),
        ({"version": protocol().version - 1}, "update this plumb"),
        ({"dbc_hash": 1}, "built from other message definitions"),
    ],
)
def test_a_mismatch_is_explained_reading_works_and_arming_does_not(
    new_board: NewBoard, other: dict[str, Any], sentence: str
) -> None:
    board = new_board()
    with Session(PlumbBus(board)) as session:
        session.protocol = replace(protocol(), **other)
        identity = session.connect()
        assert identity.mismatch is not None
        assert sentence in identity.mismatch
        assert "reading works, arming does not" in identity.mismatch
        assert session.read_parameters()[: len(CONTROL)] == CONTROL
        for refused in (session.arm, session.begin, lambda: session.upload(CONTROL)):
            with pytest.raises(LinkError, match="arming does not"):
                refused()
        # The board does not rely on the host's good manners.
        nonce = said(board.say(frame("CHALLENGE", 1, 0)))[0][1]["nonce"]
        answers = [entry for entry in said(board.say(frame("EXECUTE", 1, nonce))) if entry[0] == "NACK"]
        assert answers[0][1]["detail"] & 1
        assert not board.armed


def test_a_new_greeting_counts_anew(new_board: NewBoard) -> None:
    """After a reset of the board its counters begin at 0: that is no loss."""
    board = new_board()
    with Session.open(board) as session:
        for _ in range(5):
            session.end()
        board.reset()
        board.say(b"O\r")
        session.connect()
        assert session.counters.lost == 0


def test_silence_is_one_sentence() -> None:
    class Dead(UartBoard):
        def write(self, data: bytes) -> int:
            return len(data)

    with pytest.raises(LinkError, match="does not answer; check that it runs plumb") as caught:
        Session.open(Dead())
    assert caught.value.exit_code == 3


def test_a_board_whose_time_stands_still_does_not_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    class Frozen(UartBoard):
        def read(self, size: int = 1) -> bytes:
            return b""

    monkeypatch.setattr("plumb.link.transports.byte_stream._STANDSTILL_S", 0.05)
    with pytest.raises(LinkError, match="stands still"):
        Session.open(Frozen())


# ---- parameters ----


def test_upload_stages_and_commits(new_board: NewBoard) -> None:
    with Session.open(new_board()) as session:
        crc = session.upload(changed("esc.mid_halfus", 3100), period_us=1000)
        values = session.read_parameters()
        assert parameters.crc32(values) == crc
        assert dict(zip([row.name for row in parameters.table()], values, strict=True))["period_us"] == 1000
        assert session.connect()["PARAMETER_CRC"] == crc


@pytest.mark.parametrize("seed", range(6))
def test_upload_survives_a_bad_line(new_board: NewBoard, seed: int) -> None:
    board = new_board()
    with Session.open(board) as session:
        board.spoil_down, board.spoil_up = BadLine(seed, 0.003), BadLine(seed + 50, 0.003)
        session.upload(changed("pid.kp_q22", 1000 + seed))
        board.spoil_down = board.spoil_up = bytes
        assert session.read_parameters()[: len(CONTROL)] == changed("pid.kp_q22", 1000 + seed)


def test_another_system_begins_with_nothing_selected(new_board: NewBoard) -> None:
    """A mask of words that another record has would stream others by their names."""
    received: set[int] = set()
    with Session.open(new_board()) as session:
        session.select(frames=("QUAD_ANGLE",), words=(30,))
        system = systems.load("balancer")
        session.upload(quantise(system.TUNINGS[system.DEFAULT_TUNING]).words(), period_us=10_000)
        session.listener = lambda frames: received.update(identifier for identifier, _ in frames)
        execute_with_nonce(session, "RUN_BEGIN", session.protocol["RUN_BEGIN"].value("run", "REALTIME_LIVE"))
        session.receive(0.05)
        session.receive(0.05)
        wanted = [session.protocol[name].identifier for name in ("STEP", "QUAD_ANGLE", "WORD")]
        assert [identifier in received for identifier in wanted] == [True, False, False]


def test_a_table_is_committed_by_its_own_crc_or_not_at_all(new_board: NewBoard) -> None:
    """What was staged is not what the host meant: a value that differs, as one that CRC-8 let through would be."""
    with Session.open(new_board()) as session:
        session.connect()
        before = session.read_parameters()
        place = [row.name for row in parameters.table()].index("esc.mid_halfus")
        meant = [*before[:place], 3100, *before[place + 1 :]]
        session.request("PARAM_SET", place, 3101, answer="PARAM_STAGED", first=place)
        with pytest.raises(NackError) as refused:
            session.request("PARAM_COMMIT", len(meant), parameters.crc32(meant))
        assert refused.value.reason == "CRC" and session.read_parameters() == before
        session.request("PARAM_SET", place, 3100, answer="PARAM_STAGED", first=place)
        session.request("PARAM_COMMIT", len(meant), parameters.crc32(meant))
        assert session.read_parameters() == meant


def test_upload_ends_a_run(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.begin("LOCKSTEP")
        session.upload(CONTROL)
        assert session.end() == 0


def test_upload_refuses_with_the_reason(new_board: NewBoard) -> None:
    with Session.open(new_board()) as session:
        with pytest.raises(UsageError, match=r"esc.mid_halfus = 99999 is outside 1800 to 4200"):
            session.upload(changed("esc.mid_halfus", 99999))
        for name, value, why in (
            ("esc.max_halfus", 2900, "esc.mid_halfus = 3000 is more than esc.max_halfus = 2900"),
            ("esc.min_halfus", 3001, "esc.min_halfus = 3001 is more than esc.mid_halfus = 3000"),
            ("esc.neutral_halfus", 2001, "esc.neutral_halfus = 2001 is more than esc.min_halfus = 2000"),
        ):
            with pytest.raises(UsageError, match=f"contradict each other: {why}"):
                session.upload(changed(name, value))
        with pytest.raises(UsageError, match=r"has [0-9]+ words, not 3"):
            session.upload([1, 2, 3])
        with pytest.raises(UsageError, match="there is no parameter 'period'"):
            session.upload(CONTROL, period=3)
        assert session.read_parameters()[: len(CONTROL)] == CONTROL


def test_pulses_that_leave_no_gap_are_refused(new_board: NewBoard) -> None:
    """They would be an output that is high for ever."""
    with Session.open(new_board()) as session:
        with pytest.raises(UsageError, match=r"contradict each other: esc.max_halfus = 4041 leaves less than 20 us"):
            session.upload(changed("esc.max_halfus", 4041), esc_period_us=2040)
        session.upload(changed("esc.max_halfus", 4040), esc_period_us=2040)


# ---- telemetry under load ----


def test_a_full_queue_drops_whole_telemetry_and_never_replies(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=500)
        capture = Capture(session)
        session.listener = capture.feed
        session.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"), words=range(40))
        board.baud(up_ns=BAUD_921600_NS)  # a tenth of what is asked for
        for _ in range(2000):
            board.turn()
            assert board.receive_room >= 40  # telemetry does not crowd out what the host may want to say
        for _ in range(20):
            session.disarm()
            assert session.read_parameters()[: len(CONTROL)] == CONTROL
        session.end()
        board.baud(up_ns=0)
        board.run_us(300_000)
        session.receive(0.1)
        assert session.telemetry["COUNTERS"]["dropped"] > 1000
        assert session.counters.lost > 100  # at least: counted modulo 16
        assert session.counters.repeated_requests == 0
        bus = session.bus
        assert isinstance(bus, PlumbBus)
        assert (bus.parser.bad, bus.parser.rejected) == (0, 0)
        assert capture.unverified_from(capture.steps) is not None


def test_a_host_that_does_not_read_is_not_answered_beyond_the_queue(new_board: NewBoard) -> None:
    board = new_board()
    board.say(b"O\r")
    board.baud(up_ns=NEVER)
    requests = 400
    board.write(frame("CHALLENGE", 1, 0) * requests + b"V\r" * 300 + b"\r" * 300)
    board.run_us(100_000)
    board.baud(up_ns=1600)
    board.run_us(1_000_000)
    text = board.received()
    assert sum(name == "NONCE" for name, _ in said(text)) == requests
    assert text.count(b"V0103\r") == 300
    bare = [line for line in text.split(b"\r")[:-1] if not line]
    assert len(bare) == requests + 300


def test_the_next_step_reports_that_frames_were_dropped(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    session.pump()
    board.baud(up_ns=NEVER)
    board.run_us(200_000)
    board.baud(up_ns=0)
    board.run_us(10_000)
    steps = [words for name, words in said(board.received()) if name == "STEP"]
    jumps = [k for k in range(1, len(steps)) if steps[k]["step"] != steps[k - 1]["step"] + 1]
    assert len(jumps) == 1
    assert [k for k, words in enumerate(steps) if words["dropped"]] == jumps
    session.close()


def test_a_stale_answer_is_not_taken_for_the_new_one(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        ack, asked = protocol()["ACK"], protocol()["RUN_END"].identifier
        stale = text_of_frames([(ack.identifier, ack.pack(0, 9, asked, 999))])
        board.spoil_up = lambda data: stale + data
        assert session.end() == 0


def test_nothing_is_kept_alive_after_the_end(new_board: NewBoard) -> None:
    board = new_board()
    session = armed_session(board)
    session.end()
    sent: list[bytes] = []
    board.spoil_down = lambda data: sent.append(data) or data  # type: ignore[func-returns-value]
    for _ in range(30):
        session.receive(0.01)
    assert sent == []
    session.close()


def test_what_goes_wrong_is_counted(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:
        board.say(b"t12\r" + b"\xff\r" + frame("KEEPALIVE", 0, 1)[:-2] + b"F\r" + b"t1230\r")
        for counter in (3, 4, 9, 10, 2):  # none known before; 4 missing, then 7
            board.say(frame("PARAM_GET", 0, 0, counter=counter))
        board.run_us(200_000)
        session.receive(0.01)
        assert session.telemetry["COUNTERS"] == {"rejected": 4, "lost": 11, "dropped": 0}
        session.connect()  # a new host may begin with any counter
        board.say(frame("PARAM_GET", 0, 0, counter=13))
        board.run_us(200_000)
        session.receive(0.01)
        assert session.telemetry["COUNTERS"]["lost"] == 11


def test_status_shows_the_run(new_board: NewBoard) -> None:
    board = new_board()
    with Session.open(board) as session:

        def status() -> dict[str, int]:
            board.run_us(200_000)
            session.receive(0.01)
            return session.telemetry["STATUS"]

        assert (status()["mode"], status()["live"]) == (0, 0)
        session.begin("REALTIME_LIVE")
        assert (status()["mode"], status()["live"]) == (2, 1)
        session.end()
        assert (status()["mode"], status()["live"]) == (0, 0)
        session.begin("LOCKSTEP")
        assert (status()["mode"], status()["live"], status()["blocked"]) == (1, 0, 4)
        board.say(frame("PARAM_SET", 0, 0))
        assert status()["staged"] == 1


# ---- anything at all ----


@pytest.mark.parametrize("run", [None, "LOCKSTEP", "REALTIME_INJECTED", "REALTIME_LIVE"])
def test_no_frame_and_no_noise_upsets_the_board(new_board: NewBoard, run: str | None) -> None:
    """Well-sealed frames of every kind with any content, and noise; undefined behaviour would trap."""
    rng = random.Random(run)
    board = new_board()
    board.say(b"O\r" + frame("HELLO", protocol().version, protocol().dbc_hash), turns=20)
    messages = [message for message in protocol().messages.values() if message.sender == "HOST"]
    if run:
        begin(board, run)
        messages = [message for message in messages if message.name != "RUN_END"]
    board.baud(down_ns=1600)
    for _ in range(3000):
        message = rng.choice(messages)
        body = rng.choice([rng.randbytes(6), bytes(6), b"\xff" * 6, bytes([rng.randrange(64), 0]) + rng.randbytes(4)])
        data = bytes([0, rng.randrange(256)]) + body
        sealed = bytes([crc8(message.identifier, data)]) + data[1:]
        board.write(text_of_frames([(message.identifier, sealed)]))
        if rng.random() < 0.05:
            board.write(rng.randbytes(30) + rng.choice([b"\r", b"", b"L\r", b"C\rO\r"]))
        board.turn()
    board.run_us(500_000)
    board.received()
    with Session.open(board) as session:
        session.upload(CONTROL)
        session.begin("LOCKSTEP")


def test_any_python_can_bus_carries_a_session(new_board: NewBoard) -> None:
    """CAN interfaces know nothing of chunks: one message at a time, through python-can's own interface."""

    class Plain(can.BusABC):
        def __init__(self, inner: PlumbBus) -> None:
            self._inner = inner
            super().__init__("plain")

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            self._inner.send(msg, timeout)

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            return self._inner._recv_internal(timeout)

        def shutdown(self) -> None:
            super().shutdown()
            self._inner.shutdown()

    raw = np.arange(300).reshape(100, 3)
    with Session(Plain(PlumbBus(new_board()))) as session:
        assert session.connect().mismatch is None
        session.upload(CONTROL)
        digests = Lockstep(session).run(raw, np.zeros(100))
    with Session.open(new_board()) as session:
        session.upload(CONTROL)
        assert np.array_equal(Lockstep(session).run(raw, np.zeros(100)), digests)


class CoarseBus(can.BusABC):
    """A simulated bus without frames: its time passes in steps of step_s, and it rounds a wait down to whole steps."""

    def __init__(self, step_s: float) -> None:
        self.now_s, self.step_s, self.reads, self.rejected = 0.0, step_s, 0, 0
        super().__init__("coarse")

    def clock(self) -> float:
        return self.now_s

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        self.reads += 1
        assert self.reads < 1000, "the session loops"
        self.now_s += timeout_s // self.step_s * self.step_s if self.step_s else 0.0
        return []

    def write_frames(self, frames: Sequence[Frame]) -> None:
        pass

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        pass


def test_receive_ends_on_a_bus_that_rounds_a_short_wait_to_nothing() -> None:
    bus = CoarseBus(1 / 1024)
    assert Session(bus).receive(2.5 / 1024) == []
    assert bus.now_s >= 2.5 / 1024
    bus.shutdown()


def test_receive_refuses_a_bus_whose_time_stands_still() -> None:
    bus = CoarseBus(0.0)
    with pytest.raises(LinkError, match="time does not pass"):
        Session(bus).receive(0.1)
    bus.shutdown()

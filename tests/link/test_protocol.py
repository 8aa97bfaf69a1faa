"""Transcripts: send this, receive that. Text as it stands on the wire, against the C session."""

from __future__ import annotations

from itertools import pairwise

import pytest

from plumb.link.board_frames import PERIODIC
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from support.native_board import BAUD_921600_NS, NewBoard, UartBoard
from support.transcripts import begin, frame, said


@pytest.fixture
def board(new_board: NewBoard) -> UartBoard:
    return new_board()


@pytest.fixture
def opened(new_board: NewBoard) -> UartBoard:
    board = new_board()
    assert board.say(b"O\r") == b"\r"
    board.say(frame("HELLO", protocol().version, protocol().dbc_hash), turns=20)
    return board


# ---- commands of SLCAN ----


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"\r", b"\r"),
        (b"\r\r\r", b"\r\r\r"),
        (b"C\r", b"\r"),
        (b"O\rO\r", b"\r\r"),
        (b"O\rC\rC\r", b"\r\r\r"),
        (b"L\r", b"\r"),
        (b"S6\r", b"\r"),
        (b"s001C\r", b"\r"),
        (b"V\r", b"V0103\r"),
        (b"N\r", b"N0001\r"),
        (b"C\rS8\rO\r", b"\r\r\r"),
        (b"X1\r", b"\a"),
        (b"Z0\r", b"\a"),
        (b"T123456788001122334455667\r", b"\a"),
        (b"r1230\r", b"\a"),
        (b"O1\r", b"\a"),
        (b"t12\r", b"\a"),
        (b"\xff\xfe\r", b"\a"),
        (b"W" * 100 + b"\rC\r", b"\a\r"),
        (b"\aC\r", b"\r"),
    ],
)
def test_slcan_commands(board: UartBoard, command: bytes, answer: bytes) -> None:
    assert board.say(command) == answer


def test_frames_are_refused_while_closed_and_read_only(board: UartBoard) -> None:
    hello = frame("HELLO", 1, 0)
    assert board.say(hello) == b"\a"
    assert board.say(b"L\r" + hello) == b"\r\a"
    assert board.say(b"O\r" + hello).startswith(b"\r\r" + b"t7FD8")


def test_a_frame_is_answered_by_one_cr_or_bell(opened: UartBoard) -> None:
    good = frame("KEEPALIVE", 0, 1)
    assert opened.say(good) == b"\r"
    assert opened.say(good.lower()) == b"\r"
    assert opened.say(good[:-2] + bytes([good[-2] ^ 1]) + b"\r") == b"\a"
    assert opened.say(b"t1238" + b"0" * 16 + b"\r") == b"\a"  # wrong CRC
    other = b"t1238" + b"%02X" % 0x00 + b"0" * 14 + b"\r"
    assert opened.say(other) == b"\a"
    assert opened.say(b"t12320000\r") == b"\a"  # right text, wrong length


def test_unknown_identifiers_are_let_by(opened: UartBoard) -> None:
    from plumb.spec.protocol import crc8

    data = bytes([crc8(0x3FF, bytes(8))]) + bytes(7)
    assert opened.say(text_of_frames([(0x3FF, data)])) == b"\r"


# ---- connect ----


def test_hello_is_answered_by_identity(board: UartBoard) -> None:
    answer = board.say(b"O\r" + frame("HELLO", protocol().version, protocol().dbc_hash), turns=20)
    items = [(words["item"], words["value"]) for name, words in said(answer) if name == "IDENTITY"]
    names = protocol()["IDENTITY"].choices["item"]
    assert [names[item] for item, _ in items] == list(names.values())
    values = {names[item]: value for item, value in items}
    assert values["PROTOCOL_VERSION"] == 3
    assert values["DBC_HASH"] == protocol().dbc_hash
    assert values["PARAMETER_COUNT"] == len(parameters.table())
    assert values["PARAMETER_CRC"] == parameters.crc32([row.default for row in parameters.table()])
    assert (values["GIT_HASH_0"], values["GIT_HASH_1"]) == (0x01234567, 0x89ABCDEF)
    assert (values["FLASH_KIB"], values["RAM_KIB"], values["PART_ID"]) == (64, 20, 0x410)


# ---- parameters ----


def test_staged_parameters_have_no_effect_before_commit(opened: UartBoard) -> None:
    rows = parameters.table()
    index = next(i for i, row in enumerate(rows) if row.name == "esc.mid_halfus")
    words = [row.default for row in rows]
    assert said(opened.say(frame("PARAM_SET", index, 2222))) == [("PARAM_STAGED", {"index": index, "value": 2222})]
    assert said(opened.say(frame("PARAM_GET", index, 0))) == [
        ("PARAM_VALUE", {"index": index, "value": rows[index].default})
    ]
    old = parameters.crc32(words)
    assert said(opened.say(frame("PARAM_COMMIT", len(words), old)))[0][1]["reason"] == 5  # CRC
    words[index] = 2222
    new = parameters.crc32(words)
    assert said(opened.say(frame("PARAM_COMMIT", len(words) - 1, new)))[0][1]["reason"] == 4  # COUNT
    assert said(opened.say(frame("PARAM_COMMIT", len(words), new, counter=7))) == [
        ("ACK", {"request_counter": 7, "request": 0x052, "detail": new})
    ]
    assert said(opened.say(frame("PARAM_GET", index, 0)))[0][1]["value"] == 2222


def test_hello_forgets_what_was_staged(opened: UartBoard) -> None:
    words = [row.default for row in parameters.table()]
    opened.say(frame("PARAM_SET", 40, 5))
    opened.say(frame("HELLO", protocol().version, protocol().dbc_hash), turns=20)
    assert said(opened.say(frame("PARAM_COMMIT", len(words), parameters.crc32(words))))[0][0] == "ACK"


@pytest.mark.parametrize("index", range(len(parameters.table())))
def test_limits_of_every_parameter(opened: UartBoard, index: int) -> None:
    row = parameters.table()[index]
    for value, fits in [(row.min, True), (row.max, True), (row.min - 1, False), (row.max + 1, False)]:
        if not -(1 << 31) <= value < 1 << 32 or (row.type == "int32") != (-(1 << 31) <= value < 1 << 31):
            continue
        ((name, words),) = said(opened.say(frame("PARAM_SET", index, value & 0xFFFFFFFF)))
        assert (name == "PARAM_STAGED") == fits
        assert words.get("reason", 3) == 3


def test_dump_and_wrong_index(opened: UartBoard) -> None:
    values = said(opened.say(frame("PARAM_GET", 0xFFFF, 0), turns=len(parameters.table())))
    assert [words["index"] for _, words in values] == list(range(len(parameters.table())))
    count = len(parameters.table())
    for request in ("PARAM_GET", "PARAM_SET"):
        ((name, words),) = said(opened.say(frame(request, count, 0)))
        assert (name, words["reason"], words["detail"]) == ("NACK", 2, count)


def test_no_commit_during_a_run(opened: UartBoard) -> None:
    begin(opened, "LOCKSTEP")
    words = [row.default for row in parameters.table()]
    commit = frame("PARAM_COMMIT", len(words), parameters.crc32(words))
    assert said(opened.say(commit))[0][1]["reason"] == 7  # BUSY
    assert said(opened.say(frame("RUN_END", 0, 0)))[0][0] == "ACK"
    assert said(opened.say(commit))[0][0] == "ACK"


# ---- nonces ----


def test_a_nonce_is_good_once_for_its_verb_and_for_a_second(opened: UartBoard) -> None:
    def ask(verb: int) -> int:
        return said(opened.say(frame("CHALLENGE", verb, 0)))[0][1]["nonce"]

    def answer(verb: int, nonce: int) -> str:
        name, words = said(opened.say(frame("RUN_BEGIN", verb, nonce)))[0]
        return protocol()["NACK"].choice("reason", words["reason"]) if name == "NACK" else name

    nonce = ask(16)
    assert answer(16, nonce ^ 1) == "NONCE"
    assert answer(16, nonce) == "NONCE"  # used up by the wrong answer
    nonce = ask(16)
    assert answer(17, nonce) == "NONCE"  # asked for another verb
    nonce = ask(16)
    assert answer(16, nonce) == "ACK"
    assert answer(16, nonce) == "NONCE"  # used up
    nonce = ask(16)
    opened.run_us(1_100_000, 1000)
    opened.received()
    assert answer(16, nonce) == "NONCE"
    assert len({ask(16) for _ in range(100)}) == 100


def test_a_verb_that_is_none(opened: UartBoard) -> None:
    nonce = said(opened.say(frame("CHALLENGE", 9, 0)))[0][1]["nonce"]
    assert said(opened.say(frame("EXECUTE", 9, nonce)))[0][1]["reason"] == 1  # UNSUPPORTED


# ---- telemetry ----


def test_a_step_of_any_size_follows_as_there_is_room(opened: UartBoard) -> None:
    """More than the queue holds: the words follow, and the next step waits for them."""
    for bank in (0, 1, 2):
        assert said(opened.say(frame("SELECT", bank, 0xFFFFFFFF)))[0][0] == "ACK"
    assert said(opened.say(frame("SELECT", 99, 0)))[0][1]["reason"] == 2  # INDEX
    begin(opened, "LOCKSTEP")
    opened.baud(up_ns=BAUD_921600_NS)
    opened.write(frame("SAMPLE_A", 1, 2, 3, counter=0) + frame("SAMPLE_A", 4, 5, 6, counter=1))
    opened.run_us(100_000)
    received = [entry for entry in said(opened.received()) if entry[0] in ("STEP", "WORD")]
    words = [number for number in protocol()["WORD"].choices["index"] if number >> 8 == 0]  # of the system in use
    once = ["STEP", *["WORD"] * len(words)]
    assert [name for name, _ in received] == once + once
    assert [values["index"] for name, values in received if name == "WORD"] == words + words


def test_periodic_telemetry_only_while_open(board: UartBoard) -> None:
    names = [message.name for message in protocol().by_identifier.values()]
    assert {"TIME", "STATUS"} <= set(names)
    board.run_us(1_000_000)
    assert board.received() == b""
    board.say(b"O\r")
    board.run_us(1_000_000)
    identifiers = [identifier for identifier, _ in SlcanParser().feed(board.received())]
    count = {name: identifiers.count(protocol()[name].identifier) for name in PERIODIC}
    # TIME comes every 50 ms and the others every 100, in one second: one more or less at each end.
    assert 18 <= count["TIME"] <= 21
    assert all(9 <= count[name] <= 11 for name in PERIODIC[1:])
    board.say(b"C\r")
    board.run_us(1_000_000)
    assert board.received() == b""


def test_the_clock_wraps() -> None:
    board = UartBoard(time_us=(1 << 32) - 300_000)
    board.say(b"O\r")
    board.run_us(600_000)
    time = protocol()["TIME"]
    frames = SlcanParser().feed(board.received())
    times = [time.unpack(data)[3] for identifier, data in frames if identifier == time.identifier]
    gaps = {(b - a) & 0xFFFFFFFF for a, b in pairwise(times)}
    assert gaps == {50_000}
    assert times[0] > times[-1]


# ---- live parameters ----


def staged(board: UartBoard, **changed: int) -> bytes:
    """Stage these on top of the table in use; the commit of the result."""
    said_of = said(board.say(frame("PARAM_GET", 0xFFFF, 0), turns=60))
    words = {words["index"]: words["value"] for name, words in said_of if name == "PARAM_VALUE"}
    for place, row in enumerate(parameters.table()):
        if row.name.replace(".", "_") in changed:
            words[place] = changed[row.name.replace(".", "_")]
            answers = said(board.say(frame("PARAM_SET", place, words[place])))
            assert [name for name, _ in answers if name in ("PARAM_STAGED", "NACK")] == ["PARAM_STAGED"]
    return frame("PARAM_COMMIT", len(words), parameters.crc32([words[place] for place in range(len(words))]))


def answers_of(board: UartBoard, request: bytes) -> dict[str, dict[str, int]]:
    return {name: words for name, words in said(board.say(request)) if name in ("ACK", "NACK", "PARAM_USED")}


@pytest.mark.parametrize("run", ["REALTIME_LIVE", "REALTIME_INJECTED"])
def test_gains_change_during_a_run_that_is_not_armed(opened: UartBoard, run: str) -> None:
    begin(opened, run)
    opened.run_us(50_000)
    commit = staged(opened, pid_kp_q22=5)
    answers = answers_of(opened, commit)
    assert answers["ACK"]["detail"] == answers["PARAM_USED"]["crc"] and answers["PARAM_USED"]["run_tag"]
    opened.run_us(100_000)
    end = said(opened.say(frame("RUN_END", 0, 0)))
    steps = next(words["detail"] for name, words in end if name == "ACK")
    assert 2 <= answers["PARAM_USED"]["step"] <= steps - 4, "the run went on"


def test_a_commit_that_is_repeated_during_a_run_is_answered_alike(opened: UartBoard) -> None:
    begin(opened, "REALTIME_LIVE")
    commit = staged(opened, pid_kp_q22=5)
    assert "ACK" in answers_of(opened, commit) and "ACK" in answers_of(opened, commit)


def test_what_is_not_live_waits_for_the_end_of_the_run(opened: UartBoard) -> None:
    begin(opened, "REALTIME_LIVE")
    for changed in ({"arm_hold_ms": 5}, {"pid_kp_q22": 5, "kalman_qb": 5}, {"esc_mid_halfus": 3001}):
        assert answers_of(opened, staged(opened, **changed))["NACK"]["reason"] == 7  # BUSY


def test_gains_do_not_change_in_lockstep(opened: UartBoard) -> None:
    begin(opened, "LOCKSTEP")
    assert answers_of(opened, staged(opened, pid_kp_q22=5))["NACK"]["reason"] == 7  # BUSY


def test_a_commit_without_a_run_is_not_announced(opened: UartBoard) -> None:
    assert set(answers_of(opened, staged(opened, pid_kp_q22=5))) == {"ACK"}

"""Parameters that survive: saved, loaded and reset over the link, and found again at the next start or said to be lost.

The slots under every power cut: tests/c/test_store.c, and on the virtual board tests/f103/test_f103_store.py.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.link import LinkBoard
from plumb.errors import LinkError
from plumb.link.session import Session
from plumb.spec import parameters
from support.native_board import NewBoard, UartBoard

CONTROL = [row.default for row in parameters.table() if row.owner == "control"]
DEFAULTS = [row.default for row in parameters.table()]


@pytest.fixture
def board(new_board: NewBoard) -> UartBoard:
    return new_board()


@pytest.fixture
def session(board: UartBoard) -> Iterator[Session]:
    with Session.open(board) as opened:
        yield opened


def changed(period_us: int) -> list[int]:
    return parameters.whole_table(CONTROL, period_us=period_us)


def after_reset(board: UartBoard) -> tuple[list[int], str, int]:
    """Values in use, where they come from, and the faults in the low byte, after power off and on."""
    board.reset()
    board.turn()
    with Session.open(board) as session:
        identity = session.connect()
        return session.read_parameters(), identity.parameter_source, identity["FAULTS"] & 0xFF


def test_what_is_not_saved_is_gone_after_a_reset(board: UartBoard) -> None:
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000)
        assert session.connect().parameter_source == "set by a host and not saved"
    assert after_reset(board) == (DEFAULTS, "factory defaults", 0)


def test_what_is_saved_is_there_after_a_reset(board: UartBoard) -> None:
    for number, period_us in enumerate((3000, 4000, 5000), 1):
        with Session.open(board) as session:
            session.upload(CONTROL, period_us=period_us)
            session.execute("SAVE")
            assert session.connect().parameter_source == f"saved in flash, number {number}"
        assert after_reset(board) == (changed(period_us), f"saved in flash, number {number}", 0)


def test_load_and_reset_change_what_is_in_use_and_not_what_is_saved(board: UartBoard, session: Session) -> None:
    session.upload(CONTROL, period_us=3000)
    session.execute("SAVE")
    session.execute("DEFAULTS")
    assert session.read_parameters() == DEFAULTS
    assert session.connect().parameter_source == "factory defaults"
    session.execute("LOAD")
    assert session.read_parameters() == changed(3000)
    assert session.connect().parameter_source == "saved in flash, number 1"
    session.execute("DEFAULTS")
    assert after_reset(board)[0] == changed(3000)


def test_nothing_saved_is_nothing_to_load(session: Session) -> None:
    session.upload(CONTROL, period_us=3000)
    with pytest.raises(LinkError, match="nothing is saved"):
        session.execute("LOAD")
    assert session.read_parameters() == changed(3000)


def test_saving_forgets_nothing_that_is_staged_and_loading_does(board: UartBoard, session: Session) -> None:
    """A commit is what was staged since, on top of what is in use."""
    index = [row.name for row in parameters.table()].index("period_us")
    session.execute("SAVE")
    session.request("PARAM_SET", index, 3000, answer="PARAM_STAGED", first=index)
    session.execute("SAVE")
    session.parameters.commit(len(DEFAULTS), parameters.crc32(changed(3000)))
    assert session.read_parameters() == changed(3000)
    session.request("PARAM_SET", index, 4000, answer="PARAM_STAGED", first=index)
    session.execute("LOAD")
    with pytest.raises(LinkError):
        session.parameters.commit(len(DEFAULTS), parameters.crc32(changed(4000)))
    assert session.read_parameters() == DEFAULTS


@pytest.mark.parametrize("verb", ["SAVE", "LOAD", "DEFAULTS", "BOOTLOADER"])
def test_in_a_run_and_armed_they_are_refused(board: UartBoard, session: Session, verb: str) -> None:
    session.begin("REALTIME_LIVE")
    session.arm()
    cells = bytes(board.flash_cells())
    with pytest.raises(LinkError, match="a run is on"):
        session.execute(verb)
    assert board.armed and bytes(board.flash_cells()) == cells and not board.leaves


@pytest.mark.parametrize("verb", ["SAVE", "LOAD", "DEFAULTS", "BOOTLOADER"])
def test_they_answer_a_nonce_of_their_own(board: UartBoard, session: Session, verb: str) -> None:
    number = session.protocol["EXECUTE"].value("verb", verb)
    session.request("CHALLENGE", number % 5 + 1, 0, answer="NONCE")
    cells = bytes(board.flash_cells())
    with pytest.raises(LinkError, match="nonce"):
        session.request("EXECUTE", number, 12345)
    assert bytes(board.flash_cells()) == cells and not board.leaves


def test_a_worn_flash_says_no_and_keeps_the_old_set(board: UartBoard) -> None:
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000)
        session.execute("SAVE")
        worn = board.mcu.flash_stuck_high
        worn[1024 + 30] = 0xFFFF
        session.upload(CONTROL, period_us=4000)
        try:
            with pytest.raises(LinkError, match="its flash does not take it, what was saved before is still there"):
                session.execute("SAVE")
        finally:
            worn[1024 + 30] = 0
    assert after_reset(board)[0] == changed(3000)


def test_a_damaged_set_blocks_arming_until_it_is_replaced(board: UartBoard) -> None:
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000)
        session.execute("SAVE")
    board.flash_cells()[40] ^= 1
    assert after_reset(board) == (DEFAULTS, "factory defaults: what was saved is damaged", 0x80)
    with Session.open(board) as session:
        session.begin("REALTIME_LIVE")
        with pytest.raises(LinkError, match="the board has a fault"):
            session.arm()
        session.end()
        session.execute("DEFAULTS")
        board.turn()
        session.begin("REALTIME_LIVE")
        session.arm()
        assert board.armed


def entry_of_another_version(board: UartBoard) -> None:
    """The saved set as a version left it that had no period_us, and something that is no more."""
    cells = board.flash_cells()
    place = 5 + 3 * [row.name for row in parameters.table()].index("period_us")
    cells[place] ^= 0x5A5A
    body = bytes(cells)[: 2 * (5 + 3 * cells[4])]
    cells[len(body) // 2], cells[len(body) // 2 + 1] = struct.unpack("<HH", struct.pack("<I", zlib.crc32(body)))


def test_what_another_version_saved_is_kept_as_far_as_it_is_known(board: UartBoard) -> None:
    default = next(row.default for row in parameters.table() if row.name == "period_us")
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000, esc_period_us=4000)
        session.execute("SAVE")
    entry_of_another_version(board)
    kept = parameters.whole_table(CONTROL, period_us=default, esc_period_us=4000)
    assert after_reset(board) == (
        kept,
        "saved in flash, number 1, 1 unknown to this image, 1 missing, at defaults",
        0,
    )
    with Session.open(board) as session:
        session.execute("DEFAULTS")
        session.execute("LOAD")
        assert session.read_parameters() == kept and "1 unknown" in session.connect().parameter_source
        session.execute("SAVE")
        assert session.connect().parameter_source == "saved in flash, number 2"
    assert after_reset(board) == (kept, "saved in flash, number 2", 0)


def test_a_set_that_this_version_does_not_take_is_named_and_blocks_arming(board: UartBoard) -> None:
    with Session.open(board) as session:
        session.upload(CONTROL, period_us=3000)
        session.execute("SAVE")
        session.upload(CONTROL, period_us=5000)
        cells = board.flash_cells()
        place = 5 + 3 * [row.name for row in parameters.table()].index("period_us")
        cells[place + 1] = cells[place + 2] = 0  # no period at all
        body = bytes(cells)[: 2 * (5 + 3 * cells[4])]
        cells[len(body) // 2], cells[len(body) // 2 + 1] = struct.unpack("<HH", struct.pack("<I", zlib.crc32(body)))
        with pytest.raises(LinkError, match="contradict"):
            session.execute("LOAD")
        assert session.read_parameters() == changed(5000)
        session.request("PARAM_SET", 0, CONTROL[0], answer="PARAM_STAGED", first=0)
        session.parameters.commit(len(DEFAULTS), parameters.crc32(changed(5000)))
    values, source, faults = after_reset(board)
    assert values == DEFAULTS and source.startswith("factory defaults: ") and faults == 0x80


def test_the_way_into_the_bootloader_begins_when_the_answer_is_out(board: UartBoard, session: Session) -> None:
    session.execute("BOOTLOADER")
    assert not board.leaves
    board.run_us(99_000)
    assert not board.leaves
    board.run_us(2_000)
    assert board.leaves


@pytest.mark.parametrize("arms", [False, True], ids=["run", "armed run"])
def test_a_run_withdraws_the_request_for_the_bootloader(board: UartBoard, session: Session, arms: bool) -> None:
    session.execute("BOOTLOADER")
    session.begin("REALTIME_LIVE")
    if arms:
        session.arm()
    for _ in range(100):
        session.receive(0.005)
        assert board.armed == arms and not board.leaves
    session.disarm()
    session.end()
    board.run_us(200_000)
    assert not board.leaves


def test_the_arm_switch_withdraws_the_request_for_the_bootloader(board: UartBoard, session: Session) -> None:
    board.switch(False)
    board.run_us(50_000)
    session.execute("BOOTLOADER")
    board.switch(True)
    board.run_us(300_000)
    board.switch(False)
    board.run_us(200_000)
    assert not board.leaves


def command(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = front.main(["params", *arguments, "--board", "memory"])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_command_saves_loads_and_resets(
    board: UartBoard, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def opened(_spec: str, **_options: Any) -> LinkBoard:
        return LinkBoard("memory", Session.open(board))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    code, _, err = command(capsys, "load")
    assert code == 3 and err == "plumb: the board refused EXECUTE: nothing is saved\n"
    code, out, _ = command(capsys, "set", "arm_hold_ms=5", "--save", "--json")
    assert code == 0 and json.loads(out)["source"] == "saved in flash, number 1"
    code, out, _ = command(capsys, "reset")
    assert "arm_hold_ms: 5 -> 1000" in out and "they are factory defaults" in out
    code, out, _ = command(capsys, "load")
    assert "arm_hold_ms: 1000 -> 5" in out and "they are saved in flash, number 1" in out
    command(capsys, "set", "arm_hold_ms=6")
    code, out, _ = command(capsys, "save")
    assert code == 0 and "nothing changed; they are saved in flash, number 2" in out
    board.reset()
    _, out, _ = command(capsys, "get", "arm_hold_ms", "--json")
    assert json.loads(out)["parameters"][0]["value"] == 6
    command(capsys, "reset", "--save")
    board.reset()
    _, out, _ = command(capsys, "get", "arm_hold_ms", "--json")
    assert json.loads(out)["parameters"][0]["value"] == 1000

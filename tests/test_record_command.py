"""`plumb record` and `plumb link-test`: what a board said is in the files, and what a link lost is counted."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import can
import pytest

from link_board import MemoryBoard
from plumb.commands import link_test
from plumb.parameters import table
from plumb.recorder import Recorder
from plumb.serialbus import PlumbBus
from plumb.session import SELECTABLE, Session


@pytest.fixture
def board() -> MemoryBoard:
    return MemoryBoard()


@pytest.fixture
def session(board: MemoryBoard) -> Session:
    opened = Session(PlumbBus(board))
    opened.connect()
    return opened


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "steps.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def recorded(board: MemoryBoard, session: Session, folder: Path, seconds: float = 0.5) -> Recorder:
    recorder = Recorder(session, folder, SELECTABLE)
    board.sensors((1700, 2100, 2900, 0, 0, 0))
    session.listener = recorder.feed
    session.begin("REALTIME_LIVE", frames=("RAW_A", "ANGLE"))
    end = session.clock() + seconds
    while session.clock() < end:
        session.receive(0.01)
    session.listener = None
    session.end()
    recorder.close()
    return recorder


def test_a_recording_has_a_row_for_every_step_and_every_frame(
    board: MemoryBoard, session: Session, tmp_path: Path
) -> None:
    recorder = recorded(board, session, tmp_path)
    rows = rows_of(tmp_path)
    assert [int(row["step"]) for row in rows] == list(range(len(rows)))
    assert recorder.rows == len(rows) > 20 and recorder.lost == 0
    assert {row["raw_0_counts"] for row in rows} == {"1700"}
    assert all(len(row["digest"]) == 8 for row in rows)
    assert float(rows[-1]["tilt_deg"]) != 0 and rows[-1]["bias_dps"] == ""  # what was not selected is not there
    names = [m.arbitration_id for m in can.LogReader(tmp_path / "frames.asc")]
    assert names.count(session.protocol["STEP"].identifier) == len(rows)


def test_a_recording_tells_the_parameters_it_was_made_with(
    board: MemoryBoard, session: Session, tmp_path: Path
) -> None:
    recorded(board, session, tmp_path)
    about = json.loads((tmp_path / "board.json").read_text())
    assert about["parameters"] == {row.name: row.default for row in table()}
    assert about["board"]["PARAMETER_COUNT"] == len(table())


def test_a_lost_step_is_an_empty_row(board: MemoryBoard, session: Session, tmp_path: Path) -> None:
    step = f"t{session.protocol['STEP'].identifier:03X}".encode()
    seen = []

    def lose_one(data: bytes) -> bytes:
        at = data.find(step)
        if at >= 0:
            seen.append(at)
            if len(seen) == 5:
                return data[:at] + data[at + 22 :]
        return data

    board.spoil_up = lose_one
    recorder = recorded(board, session, tmp_path)
    assert recorder.lost == 1
    assert [row["step"] for row in rows_of(tmp_path) if not row["digest"]] != []


def test_a_good_link_passes_the_link_test(session: Session) -> None:
    result = link_test.tried(session, 400, seed=1)
    assert result["verdict"] == "pass" and result["steps"] == 400 + link_test.ONE_AT_A_TIME
    assert result["wrong_digests"] == result["host_lost"] == result["board_lost"] == 0


def test_a_link_that_loses_one_frame_fails_it_though_every_digest_is_right(
    board: MemoryBoard, session: Session
) -> None:
    sample = f"t{session.protocol['SAMPLE_A'].identifier:03X}".encode()
    spoilt = []

    def spoil_one(data: bytes) -> bytes:
        at = data.find(sample)
        if at < 0 or len(spoilt) > 2:
            return data
        spoilt.append(at)
        return data if len(spoilt) != 2 else data[: at + 9] + b"!" + data[at + 10 :]

    board.spoil_down = spoil_one
    result = link_test.tried(session, 200, seed=1)
    assert result["verdict"] == "fail" and result["wrong_digests"] == 0
    assert result["board_rejected"] == 1

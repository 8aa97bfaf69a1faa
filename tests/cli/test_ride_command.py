"""`plumb ride` from the command line: the same as `plumb fly` for vehicles that are ridden."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards.link import LinkBoard
from support.declared_systems import lacking

rides = pytest.mark.skipif(not systems.with_part("ride"), reason="no declared system has ride.py")


@rides
def test_it_ends_by_itself_and_says_what_was_ridden(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["ride", "--seconds", "0.5", "--json", "--out", str(tmp_path)]) == 0
    addresses, ridden = map(json.loads, capsys.readouterr().out.splitlines())
    assert set(addresses) == {"control", "watch"}
    assert ridden["board"] == "native" and ridden["rides"] == 0 and ridden["reports"] == [] and ridden["speed"] > 0.0


@rides
def test_wrong_use_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["ride", "--image", "none.elf"]) == 2
    captured = capsys.readouterr()
    assert "--image is for board virtual" in captured.err and len(captured.err.strip().splitlines()) == 1


@rides
def test_an_image_without_the_system_is_one_sentence_and_leaves_no_board_open(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    closed: list[LinkBoard] = []
    monkeypatch.setattr(LinkBoard, "close", lambda board: closed.append(board))
    assert front.main(["ride", "--board", "virtual", "--image", "all"]) == 2
    complaint = capsys.readouterr().err
    assert "the board's image has no wheels" in complaint and len(complaint.strip().splitlines()) == 1
    assert len(closed) == 1


@pytest.mark.parametrize("name", lacking("ride")[-1:])
def test_a_system_that_nobody_rides_is_wrong_use(name: str) -> None:
    with pytest.raises(SystemExit) as ended:
        front.main(["ride", "--system", name])
    assert ended.value.code == 2

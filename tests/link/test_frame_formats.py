"""Files of CAN tools are read by their content: every form gives the same frames and times; a cut one gives what came
before; what cannot be read is named by its line."""

from __future__ import annotations

import random
from pathlib import Path

import can
import numpy as np
import pytest

from plumb import __main__ as front
from plumb.errors import UsageError
from plumb.link import foreign_frame_reader
from plumb.readers.log_file import FRAME
from plumb.readers.log_replay import is_log, open_log
from plumb.spec.protocol import check, protocol
from support import frame_texts
from support.frame_texts import FORMS, Row
from support.recordings import recorded_run

ROWS = frame_texts.drawn_rows(random.Random(38), 400)


def decoded(path: Path, content: bytes) -> tuple[list[Row], list[str]]:
    """The frames of a file with this content, their times from the first on, and what is said of it. The reader runs in
    this process."""
    path.write_bytes(content)
    pieces = list(foreign_frame_reader.pieces(path))
    frames = b"".join(piece[1:] for piece in pieces if piece[:1] == foreign_frame_reader.FRAMES)
    notes = [piece[1:].decode() for piece in pieces if piece[:1] == foreign_frame_reader.NOTE]
    return frame_texts.rows_of(np.frombuffer(frames, FRAME)), notes


def read(path: Path, content: bytes) -> list[Row]:
    return decoded(path, content)[0]


def refusal(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(UsageError) as caught:
        list(foreign_frame_reader.pieces(path))
    return str(caught.value)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_frames(tmp_path: Path, form: str) -> None:
    write, resolution_us = FORMS[form]
    path = tmp_path / random.Random(form).choice(["a.asc", "a.csv", "a.log", "a.npz", "a"])
    found = read(path, write(ROWS))
    assert is_log(path)
    assert [row[1:] for row in found] == [row[1:] for row in ROWS]
    if resolution_us:
        assert max(abs(ours[0] - theirs[0]) for ours, theirs in zip(found, ROWS, strict=True)) <= resolution_us
    else:
        assert {row[0] for row in found} == {0}
    assert read(tmp_path / "a.gz", frame_texts.zipped(write(ROWS))) == found


@pytest.mark.parametrize("form", FORMS)
def test_a_cut_file_is_read_up_to_the_last_whole_line_and_says_so(tmp_path: Path, form: str) -> None:
    text, whole = FORMS[form][0](ROWS), read(tmp_path / "whole", FORMS[form][0](ROWS))
    lines = text.splitlines(keepends=True)
    rng = random.Random(form)
    for number in rng.sample(range(len(lines) - 150, len(lines) - 2), 3):
        kept, line = b"".join(lines[:number]), lines[number].rstrip()
        before = read(tmp_path / "kept", kept)
        assert before == whole[: len(before)] and len(before) < len(whole)
        assert read(tmp_path / "cut", kept + line[: rng.randrange(1, len(line))]) == before
        found, notes = decoded(tmp_path / "cut", kept + line)
        assert found == before
        assert f"cut is cut in line {number + 1}: it is read up to the last whole line" in notes or b"Stat" in line
    found, notes = decoded(tmp_path / "cut.gz", frame_texts.zipped(text)[:-200])
    assert found == whole[: len(found)] and 0 < len(found) < len(whole)
    assert "cut.gz is cut in line" in " ".join(notes)


@pytest.mark.parametrize("suffix", [".blf", ".mf4"])
def test_a_binary_file_is_read_when_compressed_too(tmp_path: Path, suffix: str) -> None:
    plain = tmp_path / f"a{suffix}"
    with can.Logger(plain) as log:
        for number in range(20_000):
            at, data = number * 1e-3, number.to_bytes(4, "big") * 2
            log.on_message_received(can.Message(at + 1e9, 0x300 + number % 7, is_extended_id=False, data=data))
    found = read(plain, plain.read_bytes())
    packed = frame_texts.zipped(plain.read_bytes())
    assert len(found) == 20_000 and decoded(tmp_path / "a.log", packed) == (found, []) and is_log(tmp_path / "a.log")
    if suffix == ".blf":
        before, notes = decoded(tmp_path / "cut", packed[: len(packed) * 3 // 4])
        assert before == found[: len(before)] and len(before) > 10_000
        assert notes == ["cut is cut: it is read up to the last whole part"]


def test_differences_are_reported(tmp_path: Path) -> None:
    said = decoded(tmp_path / "a", FORMS["candump -td"][0](ROWS))[1]
    assert said == ["a: its times are differences (candump -td): they are summed"]
    assert decoded(tmp_path / "a", FORMS["candump -tz"][0](ROWS))[1] == []


def test_frames_of_can_fd_are_left_out(tmp_path: Path) -> None:
    said = refusal(tmp_path / "a.asc", frame_texts.asc_canfd(ROWS, flags="303000"))
    assert "holds 400 frames of CAN FD and no classic one" in said
    mixed = frame_texts.asc(ROWS) + frame_texts.asc_canfd(ROWS[:7], flags="1000")
    assert len(read(tmp_path / "a.asc", mixed)) == 400


BEFORE_DATA = {
    "asc": b" d 8 ",
    "candump -L": b"#",
    "candump -ta": b"]  ",
    "python-can csv": b",0,0,0,8,",
    "gvret": b",0,8,",
    "busmaster": b" s 8 ",
    "trc 2.1": b" -  8 ",
}


@pytest.mark.parametrize("form", BEFORE_DATA)
def test_a_damaged_line_is_named_with_its_reason(tmp_path: Path, form: str) -> None:
    lines = FORMS[form][0](ROWS).splitlines(keepends=True)
    number = random.Random(form).randrange(100, 200)
    lines[number] = lines[number].replace(BEFORE_DATA[form], BEFORE_DATA[form] + b"*")
    said = refusal(tmp_path / "a.x", b"".join(lines))
    assert f"line {number + 1} is no whole frame" in said and said.endswith("mend or delete the line")


def test_an_unknown_file_is_refused_with_the_formats(tmp_path: Path) -> None:
    said = refusal(tmp_path / "a.asc", b"hello\nworld\n")
    assert "holds no frames in a format that plumb reads (BLF, MF4, " in said and "logconvert" in said
    said = refusal(tmp_path / "b.trc", frame_texts.trc(ROWS, "2.0").replace(b"$COLUMNS", b"$C"))
    assert "$COLUMNS" in said and "save it as version 2.1" in said


def test_frames_of_another_bus_are_reported_from_a_bus_without_a_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [(at, i | 0x600, data) for at, i, data in frame_texts.drawn_rows(random.Random(1), 1000)]
    (tmp_path / "a.log").write_bytes(frame_texts.candump_log(rows)[:-3])
    assert front.main(["export", str(tmp_path / "a.log"), str(tmp_path / "a.csv")]) == 2
    said = capsys.readouterr().err
    assert "a.log is cut in line 1000" in said and "none of the 999 frames of a.log is plumb's" in said
    known = list(protocol().by_identifier)
    drawn = random.Random(2)
    rows = [(at, drawn.choice(known), data) for at, _, data in rows]
    assert sum(check(one, data) for _, one, data in rows) > 0  # by chance
    (tmp_path / "alike.log").write_bytes(frame_texts.candump_log(rows))
    assert front.main(["replay", str(tmp_path / "alike.log"), "--board", "native"]) == 2
    assert "none of the 1,000 frames of alike.log is plumb's" in capsys.readouterr().err
    whole = frame_texts.rows_of(open_log(recorded_run(tmp_path / "whole.plog")).frames)
    status = protocol()["STATUS"].identifier
    (tmp_path / "b.log").write_bytes(frame_texts.candump_log([row for row in whole if row[1] == status]))
    assert front.main(["replay", str(tmp_path / "b.log"), "--board", "native"]) == 2
    assert "no run was in progress" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["asc, relative", "python-can csv"])
def test_a_run_in_another_tools_file_is_reproduced(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = frame_texts.rows_of(open_log(recorded_run(tmp_path / "whole.plog")).frames)
    path = tmp_path / "run.csv"
    path.write_bytes(FORMS[form][0](rows))
    assert front.main(["replay", str(path), "--board", "native"]) == 0
    assert "recorded digests is reproduced" in capsys.readouterr().out

"""A log is read as far as it is whole, wherever it was cut or damaged, and says so; its recorder may be killed."""

from __future__ import annotations

import json
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.files.block_file import BlockWriter, sealed
from plumb.readers import log_file
from plumb.readers.log_file import EXTENDED, FRAME, MAGIC, REMOTE, Log, read_log
from plumb.readers.log_replay import RecordedRun, open_log, runs_of
from plumb.spec import dbc
from plumb.spec.protocol import protocol
from plumb.writers import log_writer
from plumb.writers.log_writer import LogWriter
from support.recordings import blocks_of, recorded_run, rewritten, with_json


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log in many blocks: each batch of frames has one of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_writer, "FLUSH_EVERY_S", 0.0)
        return recorded_run(tmp_path_factory.mktemp("log") / "whole.plog")


def only_run(log: Log) -> RecordedRun:
    (found,) = runs_of(log)
    return found


def test_a_log_says_who_was_recorded_by_what_and_when(whole: Path) -> None:
    log = read_log(whole)
    assert log.head["clock"] == "simulated" and log.head["command"] == "a test"
    assert log.dbc == dbc.text() and log.done is not None and log.done["frames"] == len(log.frames)
    assert np.all(np.diff(log.frames["time_us"]) >= 0) and not log.warnings and not log.lost_blocks
    assert [block.kind for block in blocks_of(whole)][:2] == ["HEAD", "DBCT"]


def test_a_log_that_was_cut_is_a_shorter_recording(whole: Path, tmp_path: Path) -> None:
    """At every edge of a block, next to it, and inside: the part that is read is the beginning of the whole
    recording."""
    data, all_frames, path = whole.read_bytes(), read_log(whole).frames, tmp_path / "cut.plog"
    edges = [block.offset for block in blocks_of(whole)]
    random_cuts = random.Random(1).sample(range(edges[3], len(data)), 20)
    first, counts = edges[1], []
    for size in sorted({*(edge + by for edge in edges[2::7] for by in (-1, 0, 1)), *random_cuts}):
        path.write_bytes(data[:size])
        log = read_log(path)
        assert np.array_equal(log.frames, all_frames[: len(log.frames)])
        counts.append(len(log.frames))
        assert len(log.warnings) == 1 and log.warnings[0].startswith("cut.plog ")
    assert size > first and counts == sorted(counts) and counts[-1] > 0.9 * len(all_frames)


def test_steps_of_a_cut_log_are_the_first_steps_of_the_whole(whole: Path, tmp_path: Path) -> None:
    run, path = only_run(read_log(whole)).run, tmp_path / "cut.plog"
    edges = [block.offset for block in blocks_of(whole)]
    path.write_bytes(whole.read_bytes()[: edges[len(edges) // 2] + 5])
    cut = only_run(read_log(path))
    assert 3 < cut.known == cut.run.steps < run.steps and cut.unknown == ""
    for one, other in ((cut.run.raw, run.raw), (cut.run.digest, run.digest), (cut.run.setpoint, run.setpoint)):
        assert np.array_equal(one, other[: cut.known])


def test_flipped_bits_are_lost_frames_and_never_other_ones(whole: Path, tmp_path: Path) -> None:
    log, path, rng = read_log(whole), tmp_path / "flipped.plog", random.Random(7)
    known = {frame.tobytes() for frame in log.frames}
    data = whole.read_bytes()
    for _ in range(150):
        place = rng.randrange(len(MAGIC) + 1, len(data))
        flipped = bytearray(data)
        flipped[place] ^= 1 << rng.randrange(8)
        path.write_bytes(flipped)
        read = read_log(path)
        assert read.damages and read.warnings and {frame.tobytes() for frame in read.frames} <= known
        assert len(read.frames) >= len(log.frames) - 60


def test_a_log_whose_blocks_were_cut_out_says_so(whole: Path, tmp_path: Path) -> None:
    blocks = blocks_of(whole)
    path = tmp_path / "short.plog"
    body = b"".join(sealed(one.number, one.kind, one.payload) for one in blocks if one.number not in (5, 6))
    path.write_bytes(f"{MAGIC}\n".encode() + body)
    log = read_log(path)
    assert log.lost_blocks == 2 and log.warnings == ["short.plog lacks 2 blocks: part of it was cut out"]


KILLED = """
import sys
from pathlib import Path
from plumb.writers.log_writer import LogWriter

log, number = LogWriter(Path(sys.argv[1]), {}), 0
while True:
    log.add([(number & 0x7FF, number.to_bytes(8, "little"))], number * 1e-6)
    number += 1
    if number == 5000:
        print("running", flush=True)
"""


@pytest.mark.parametrize("more_s", [0.0, 0.02, 0.05])
def test_a_recorder_that_is_killed_while_it_writes_leaves_a_log(tmp_path: Path, more_s: float) -> None:
    path = tmp_path / "killed.plog"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"running\n"
        time.sleep(more_s)
        process.send_signal(signal.SIGKILL)
    log = read_log(path)
    assert len(log.frames) >= log_file.BLOCK_FRAMES and log.done is None and log.lost_blocks == 0
    assert np.array_equal(log.frames["time_us"], np.arange(len(log.frames)))
    assert np.array_equal(log.frames["data"].view("<u8").reshape(-1), np.arange(len(log.frames), dtype=np.uint64))
    assert [damage for damage in log.damages if not damage.at_end] == []


def test_many_frames_at_once_are_blocks_of_a_bounded_size(tmp_path: Path) -> None:
    path = tmp_path / "many.plog"
    with LogWriter(path, {}) as writer:
        writer.add([(0x123, bytes(8))] * 100_000, 1.0)
    sizes = [len(block.payload) for block in blocks_of(path) if block.kind == "FRMS"]
    assert sum(sizes) == 100_000 * FRAME.itemsize and max(sizes) == log_file.BLOCK_FRAMES * FRAME.itemsize


def test_frames_of_any_bus_keep_what_they_are(tmp_path: Path) -> None:
    messages = [
        can.Message(timestamp=1e9, arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"\1\2\3"),
        can.Message(timestamp=1e9 + 1, arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=4),
        can.Message(timestamp=1e9 + 2, arbitration_id=0x7FF, is_extended_id=False, data=bytes(8), is_rx=False),
    ]
    with LogWriter(tmp_path / "bus.plog", {"part": {"bus": "a test"}}) as writer:
        for message in messages:
            writer.add_message(message)
    log = read_log(tmp_path / "bus.plog")
    assert log.frames["can_id"].tolist() == [0x1ABCDEF0 | EXTENDED, 0x123 | REMOTE, 0x7FF]
    assert log.frames["length"].tolist() == [3, 4, 8] and log.frames["sent"].tolist() == [0, 0, 1]
    assert log.frames["time_us"].tolist() == [10**15, 10**15 + 10**6, 10**15 + 2 * 10**6]
    assert log.head["clock"] == "utc"


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "does not begin with 'plumb log 1'"), (b"plumb log 2\n", "does not begin with"),
        (b"\x7fELF" + bytes(100), "does not begin with"), (b"plumb log 1\n", "holds no whole block"),
        (b"plumb log 1\n" + bytes(1000), "holds no whole block"),
        (b"plumb log 1\n" + sealed(0, "HEAD", b"[1]"), "is no HEAD of a log"),
        (b"plumb log 1\n" + sealed(0, "HEAD", b"[" * 100_000), "is no HEAD of a log"),
        (b"plumb log 1\n" + sealed(0, "HEAD", b"\xff\xfe"), "is no HEAD of a log"),
        (b"plumb log 1\n" + sealed(0, "FRMS", bytes(23)), "is no FRMS of a log"),
        (b"plumb log 1\n" + sealed(0, "FRMS", b"\xff" * 22), "is no FRMS of a log"),
        (b"plumb log 1\n" + sealed(0, "PARM", b'{"values": {"system": 1.5}}'), "is no PARM of a log"),
        (b"plumb log 1\n" + sealed(0, "PARM", b'{"values": [1]}'), "is no PARM of a log"),
        (b"plumb log 1\n" + sealed(0, "PARM", b'{"values": {"system": true}}'), "is no PARM of a log"),
    ],
)  # fmt: skip
def test_what_is_no_log_is_one_sentence(tmp_path: Path, data: bytes, sentence: str) -> None:
    path = tmp_path / "file.plog"
    path.write_bytes(data)
    with pytest.raises(UsageError, match=re.escape(sentence)) as error:
        read_log(path)
    assert "\n" not in str(error.value)


def test_blocks_of_a_later_version_are_passed_over(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "later.plog"
    path.write_bytes(whole.read_bytes())
    with path.open("ab") as file:
        file.write(sealed(len(blocks_of(whole)), "LATR", b"of a later version"))
    assert np.array_equal(read_log(path).frames, read_log(whole).frames) and not read_log(path).warnings


def test_a_log_is_read_with_its_own_dbc(whole: Path, tmp_path: Path) -> None:
    """The message definitions of another version: STEP had another identifier."""
    own, other = protocol()["STEP"].identifier, 0x10F
    assert other not in protocol().by_identifier

    def moved(kind: str, payload: bytes) -> bytes:
        if kind == "DBCT":
            return payload.decode().replace(f"BO_ {own} STEP", f"BO_ {other} STEP").replace(
                f" {own} ", f" {other} "
            ).encode()  # fmt: skip
        return payload

    log = read_log(rewritten(whole, tmp_path / "other.plog", moved))
    assert log.protocol()["STEP"].identifier == other
    with pytest.raises(UsageError, match="holds no step"):
        runs_of(log)


def test_a_log_without_its_dbc_is_read_by_the_version_that_wrote_it(whole: Path, tmp_path: Path) -> None:
    lost = rewritten(whole, tmp_path / "lost.plog", lambda kind, payload: None if kind == "DBCT" else payload)
    with pytest.raises(UsageError, match=r"the DBC in .* is lost, and this plumb has another"):
        read_log(lost).protocol()

    def hashed(head: dict[str, object]) -> None:
        head["protocol"] = {"dbc_hash": f"0x{protocol().dbc_hash:08x}"}

    named = rewritten(lost, tmp_path / "named.plog", with_json("HEAD", hashed))
    assert only_run(read_log(named)).known == only_run(read_log(whole)).known


def test_a_dbc_that_is_none_is_one_sentence(whole: Path, tmp_path: Path) -> None:
    path = rewritten(whole, tmp_path / "x.plog", lambda kind, payload: b"BO_ what" if kind == "DBCT" else payload)
    with pytest.raises(UsageError, match=r"the DBC in .* cannot be read"):
        runs_of(open_log(path))


def test_twenty_lines_without_plumb_read_a_log(whole: Path) -> None:
    """The program of docs/reference/log.md, with an interpreter that finds no package."""
    program = Path(__file__).resolve().parents[2] / "examples" / "log" / "read_log.py"
    command = [sys.executable, "-I", "-S", str(program), str(whole)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    log, run = read_log(whole), only_run(read_log(whole)).run
    assert said == [
        "a test",
        f"{len(log.parameter_sets[0].values)} parameters",
        f"{len(log.frames)} frames, {run.steps} steps; the last digest is {run.digest[-1]:08x}",
    ]


def test_the_layout_of_a_frame_is_the_documented_one() -> None:
    fields = FRAME.fields
    assert fields is not None and FRAME.itemsize == 22
    assert {name: field[1] for name, field in fields.items()} == {
        "time_us": 0, "can_id": 8, "length": 12, "sent": 13, "data": 14,
    }  # fmt: skip


@pytest.mark.parametrize(
    "said",
    [
        {"true_x_m": [1.0]}, {"time_us": 1, "true_x_m": [1.0]}, {"time_us": [1], "true_x_m": [1.0, 2.0]},
        {"time_us": [1], "true_x_m": ["a"]}, {"time_us": [1], "true_x_m": [float("nan")]},
        {"time_us": [1.5], "true_x_m": [1.0]}, {"time_us": [1 << 80], "true_x_m": [1.0]},
        {"time_us": [1], "roll_deg": [1.0]},
    ],
)  # fmt: skip
def test_a_truth_that_no_recorder_writes_is_refused(tmp_path: Path, said: dict[str, object]) -> None:
    path = tmp_path / "run.plog"
    with BlockWriter(path, MAGIC, replace=False) as blocks:
        blocks.append("TRTH", json.dumps(said).encode("utf-8"))
    with pytest.raises(UsageError, match="is whole, but is no TRTH of a log"):
        read_log(path)


def test_the_truth_of_a_simulated_vehicle_reads_back(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.plog", {"command": "a test"}, simulated=True) as log:
        for number in range(30):
            log.truth({"true_height_m": 0.5 * number}, 0.1 * number)
    found = read_log(tmp_path / "run.plog").truth
    assert found == {"true_height_m": [(100_000 * number, 0.5 * number) for number in range(30)]}

"""`plumb record` and `plumb link-test`: what a board said is in the files, and what a link lost is counted."""

from __future__ import annotations

import csv
import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.cli import link_test
from plumb.contract import run_fixed
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.link import monitor
from plumb.link.selection import raw_frames_of
from plumb.link.session import Session
from plumb.link.transports.open_bus import serve_bus
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.link.transports.slcan_server import AdapterBus
from plumb.readers import log_replay
from plumb.spec import dbc, declarations
from plumb.spec.parameters import table
from plumb.spec.protocol import protocol
from plumb.writers.recorder import FrameLog, Recorder, RunMemory
from support.declared_systems import of_declared
from support.native_board import UartBoard

WAIT_S = 60.0
"""For what comes within a second, on a machine that may have other things to do."""


@pytest.fixture
def board() -> UartBoard:
    return UartBoard()


@pytest.fixture
def session(board: UartBoard) -> Session:
    opened = Session(PlumbBus(board))
    opened.connect()
    return opened


def rows_of(path: Path) -> list[dict[str, str]]:
    """The steps of a log, as its CSV has them."""
    table = path.with_suffix(".csv")
    assert front.main(["export", str(path), str(table), "--force", "--json"]) == 0
    with table.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def run_of(path: Path) -> log_replay.RecordedRun:
    return log_replay.runs_of(log_replay.open_log(path))[0]


def recorded(board: UartBoard, session: Session, path: Path, seconds: float = 0.5) -> None:
    recorder = Recorder(session, path, {})
    board.sensors((1700, 2100, 2900, 0, 0, 0))
    session.listener = recorder.feed
    session.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    end = session.clock() + seconds
    while session.clock() < end:
        session.receive(0.01)
    session.listener = None
    session.end()
    recorder.close("after half a second")


def test_a_recording_has_every_frame_and_a_row_with_time_for_every_step(
    board: UartBoard, session: Session, tmp_path: Path
) -> None:
    path = tmp_path / "run.plog"
    recorded(board, session, path)
    log, rows = log_replay.open_log(path), rows_of(path)
    assert [int(row["step"]) for row in rows] == list(range(len(rows)))
    assert [row["time_s"] for row in rows] == [f"{0.02 * step:.6f}" for step in range(len(rows))]
    run = run_of(path)
    assert run.run.steps == len(rows) > 20 and run.run.incomplete == 0 and run.known == run.run.steps
    assert {row["raw_gyro_counts"] for row in rows} == {"1700"}
    assert all(len(row["digest"]) == 8 for row in rows)
    # bias_dps was not selected: the counts say it
    words = run_fixed.run_control(run.used.params, run.run.raw, run.run.setpoint)
    bias_dps = words["bias_turnps_q28"] * 360.0 / 2**28
    assert float(rows[-1]["tilt_deg"]) != 0 and [float(row["bias_dps"]) for row in rows] == pytest.approx(bias_dps)
    assert list(log.frames["can_id"]).count(session.protocol["STEP"].identifier) == len(rows)
    assert log.done is not None and log.done["ended"] == "after half a second" and not log.warnings


@pytest.mark.parametrize(
    ("system", "frames", "columns"),
    of_declared(
        [
            (
                "phone",
                ("PHONE_ANGLE", "PHONE_BIAS", "PHONE_ROLL", "PHONE_ROLL_BIAS"),
                ("tilt_deg", "bias_dps", "roll_deg", "roll_bias_dps"),
            ),
            ("turntable", ("TURNTABLE_ATTITUDE_W", "TURNTABLE_ATTITUDE_Z"), ("w", "z", "rate_z_dps")),
            ("balancer", ("BALANCER_ANGLE", "BALANCER_DRIVE"), ("tilt_deg", "duty", "velocity_mps")),
        ]
    ),
)
def test_every_system_s_values_have_columns_of_their_own(
    board: UartBoard,
    session: Session,
    tmp_path: Path,
    system: str,
    frames: tuple[str, ...],
    columns: tuple[str, ...],
) -> None:
    module, path = systems.load(system), tmp_path / "run.plog"
    session.upload(quantise(module.TUNINGS[module.DEFAULT_TUNING]).words(), period_us=10_000)
    recorder = Recorder(session, path, {})
    board.sensors((1700, 2100, 2900, 100, 200, 300))
    session.listener = recorder.feed
    session.begin("REALTIME_LIVE", frames=frames)
    for _ in range(30):
        session.receive(0.02)
    session.listener = None
    session.end()
    recorder.close()
    rows = rows_of(path)
    assert len(rows) > 20 and run_of(path).run.incomplete == 0
    assert all(row[column] != "" for row in rows[1:-1] for column in columns)
    with path.with_suffix(".csv").open() as file:
        head = next(csv.reader(file))
    assert len(set(head)) == len(head)


def test_a_recording_shows_the_parameters_it_was_made_with(board: UartBoard, session: Session, tmp_path: Path) -> None:
    path = tmp_path / "run.plog"
    recorded(board, session, path)
    log = log_replay.open_log(path)
    assert log.parameter_sets[0].values == {row.name: row.default for row in table()}
    said = log.head["board"]
    assert isinstance(said, dict) and said["PARAMETER_COUNT"] == len(table())
    assert log.dbc == dbc.text()


def test_a_lost_step_is_a_row_without_digest(board: UartBoard, session: Session, tmp_path: Path) -> None:
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
    path = tmp_path / "run.plog"
    recorded(board, session, path)
    assert run_of(path).run.incomplete == 1
    assert [row["step"] for row in rows_of(path) if not row["digest"]] == ["4"]


def test_a_recording_is_a_page_that_says_where_it_is_and_what_made_it(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "today"
    command = ["record", "--board", "memory", "--run", "live", "--out", str(out), "--seconds", "0.5"]
    assert front.main(command) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"report: {out}.html"
    page = (tmp_path / "today.html").read_text()
    head = log_replay.open_log(tmp_path / "today.plog").head
    version = head["plumb"]
    assert isinstance(version, dict)
    assert head["command"] == f"plumb {' '.join(command)}" and version["git_hash"] in page
    for text in (head["command"], "Raw counts", "accel_y", "Signals in deg", "kalman.dt_s_q33", "no step lacks"):
        assert str(text) in page, text
    steps = run_of(tmp_path / "today.plog").run.steps
    assert f"{steps} steps of 20 ms." in page and "command, from" in page


def test_a_recording_without_a_step_is_a_log_without_a_page(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "run.plog"), "--json"]
    assert front.main(["record", "--board", "memory", "--seconds", "0.1", *out]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["steps"] == 0 and json.loads(said.out)["files"] == []
    assert said.err.count("\n") == 1 and "--run live begins one" in said.err
    assert log_replay.open_log(tmp_path / "run.plog").done is not None


def test_a_log_is_never_overwritten_unless_it_is_asked_for(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("run.plog", "run.html", "run.csv"):
        (tmp_path / name).write_text("of value")
        assert record(tmp_path / "run", "--seconds", "0.2", "--format", "csv") == 2
        assert f"{name} exists: choose another name, or give --force" in capsys.readouterr().err
        assert {path.read_text() for path in tmp_path.iterdir()} == {"of value"}
        assert record(tmp_path / "run", "--seconds", "0.2", "--format", "csv", "--force") == 0
        capsys.readouterr()
        for path in tmp_path.iterdir():
            assert path.read_bytes() != b"of value"
            path.unlink()


FULL = Path("/dev/full")
needs_full_disk = pytest.mark.skipif(not FULL.is_char_device(), reason="this system has no /dev/full")


@pytest.fixture
def recordable(board: UartBoard, monkeypatch: pytest.MonkeyPatch) -> UartBoard:
    """The board behind `plumb record --board memory`."""
    board.sensors((1700, 2100, 2900, 0, 0, 0))

    def opened(_spec: str, **_options: Any) -> LinkBoard:
        return LinkBoard("memory", Session.open(board))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    return board


def record(out: Path, *arguments: str) -> int:
    return front.main(["record", "--board", "memory", "--run", "live", "--out", str(out), "--json", *arguments])


def test_a_board_that_falls_silent_leaves_what_was_recorded_and_the_count(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    off_us = recordable.time_us + 1_000_000
    recordable.spoil_up = lambda data: data if recordable.time_us < off_us else b""
    assert record(tmp_path / "run") == 3
    said = capsys.readouterr()
    assert said.err == "plumb: the board fell silent: check cable and power, then start again\n"
    summary, log = json.loads(said.out), log_replay.open_log(tmp_path / "run.plog")
    assert summary["steps"] == run_of(tmp_path / "run.plog").run.steps > 20
    assert log.done is not None and log.done["ended"] == "the link broke"


def test_a_board_without_a_run_says_what_would_begin_one(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for more, says in (([], True), (["--run", "live"], False)):
        out = ["--out", str(tmp_path / f"run{says}")]
        assert front.main(["record", "--board", "memory", "--seconds", "0.3", *out, *more]) == 0
        assert ("--run live begins one" in capsys.readouterr().err) == says


def test_raw_counts_come_first_so_that_every_recording_can_be_replayed() -> None:
    for system in declarations.names():
        for period_us in (500, 2_500, 100_000):
            chosen = monitor.selection(period_us, system, raw_first=True)
            assert chosen[: len(raw := raw_frames_of(system))] == raw and len(set(chosen)) == len(chosen)


@needs_full_disk
def test_a_full_disk_is_one_sentence(recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "run.plog").symlink_to(FULL)
    assert record(tmp_path / "run", "--seconds", "30", "--force") == 2
    error = capsys.readouterr().err
    assert (
        error.startswith(f"plumb: {tmp_path / 'run.plog'} cannot be written: No space left") and error.count("\n") == 1
    )


def test_a_file_in_the_way_is_one_sentence(
    recordable: UartBoard, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.plog").mkdir()
    assert record(tmp_path / "run", "--force") == 2
    assert "run.plog cannot be written: Is a directory" in capsys.readouterr().err


def test_what_is_recorded_is_on_the_disk_within_a_quarter_of_a_second(
    board: UartBoard, session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a recorder that is killed leaves it."""
    monkeypatch.setattr("plumb.writers.log_writer.FLUSH_EVERY_S", 0.0)
    path = tmp_path / "run.plog"
    recorder = Recorder(session, path, {})
    session.listener = recorder.feed
    session.begin("REALTIME_LIVE", frames=("RAW_A",))
    for _ in range(30):
        session.receive(0.02)
    log = log_replay.open_log(path)
    assert len(log.frames) == recorder.frames and log.done is None
    assert log.warnings == ["run.plog has no end: the recorder was killed, or still writes it"]
    session.listener = None
    recorder.close()


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".csv", ".log", ".trc"])
def test_every_format_of_a_log_is_read_back(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    with FrameLog(path) as log:
        for number in range(5):
            log.add_message(
                can.Message(timestamp=1e9 + number, arbitration_id=0x100, is_extended_id=False, data=bytes([number]))
            )
            log.flush()
    assert [bytes(message.data) for message in can.LogReader(path)] == [bytes([number]) for number in range(5)]


def test_a_log_of_no_known_format_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="a log of frames ends in"):
        FrameLog(tmp_path / "bus.txt")


def test_a_bus_is_recorded_without_a_word_and_what_is_missing_is_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second that it is to last is over when the last frame is in the log."""
    far = serve_bus("tcp:127.0.0.1:0")
    assert isinstance(far, AdapterBus)
    angle, received, read_only, stop = protocol()["QUAD_ANGLE"], [], set(), threading.Event()

    def speak() -> None:
        counter = 0
        while not stop.is_set():
            received.append(far.recv(0.005))
            if far.open and counter < 40:
                read_only.add(far.read_only)
                data = angle.pack(counter & 15, 0, 1, counter) if counter != 9 else bytes(8)
                far.send(can.Message(arbitration_id=angle.identifier, data=data, is_extended_id=False))
                counter += 2 if counter == 20 else 1

    add, logged, start_s = FrameLog.add_message, [], time.monotonic()

    def adding(log: FrameLog, message: can.Message) -> None:
        add(log, message)
        logged.append(message)

    def passed_s() -> float:
        return 2.0 if len(logged) == 38 else (time.monotonic() - start_s) / WAIT_S

    monkeypatch.setattr(FrameLog, "add_message", adding)
    monkeypatch.setattr("plumb.cli.record.time", SimpleNamespace(monotonic=passed_s))
    thread = threading.Thread(target=speak)
    thread.start()
    address = far.channel_info.split("//")[1]
    log = tmp_path / "bus.asc"
    try:
        assert front.main(["record", "--bus", f"tcp:{address}", "--out", str(log), "--seconds", "1", "--json"]) == 0
    finally:
        stop.set()
        thread.join()
        far.shutdown()
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frames"], summary["rejected"], summary["lost"]) == (38, 1, 2)
    assert len(list(can.LogReader(log))) == 38
    assert not any(received) and read_only == {True}


def test_a_good_link_passes_the_link_test(session: Session) -> None:
    result = link_test.tried(session, 400, seed=1)
    assert result["verdict"] == "pass" and result["steps"] == 400 + link_test.ONE_AT_A_TIME
    assert result["wrong_digests"] == result["host_lost"] == result["board_lost"] == 0


def test_a_link_that_loses_one_frame_fails_it_though_every_digest_is_right(board: UartBoard, session: Session) -> None:
    sample = f"t{session.protocol['SAMPLE_A'].identifier:03X}".encode()
    spoilt: list[int] = []

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


def test_on_the_virtual_board_a_systems_plant_is_on_the_pins(tmp_path: Path) -> None:
    pytest.importorskip("unicorn")
    from plumb.errors import UsageError
    from plumb.flash.image import find_image

    try:
        find_image()
    except UsageError as error:
        pytest.skip(str(error))
    command = ["record", "--board", "virtual", "--run", "live", "--system", "turntable", "--seconds", "0.5"]
    assert front.main([*command, "--out", str(tmp_path / "run")]) == 0
    run = run_of(tmp_path / "run.plog").run
    assert run.steps > 100 and ((run.raw[:, :6] > 1800) & (run.raw[:, :6] < 2300)).all()  # at rest: half of 3.3 V


def test_what_is_remembered_of_a_run_is_all_of_it_or_nothing(
    board: UartBoard, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, step = RunMemory(), session.protocol["STEP"].identifier
    session.listener = lambda frames: memory.feed(frames, 0.0)
    for _ in range(2):  # the second run alone is remembered
        session.begin("REALTIME_LIVE", frames=("RAW_A",))
        for _ in range(20):
            session.receive(0.02)
        frames = [frame for _, batch in memory.batches for frame in batch]
        numbers = [session.protocol["STEP"].unpack(data)[2] for identifier, data in frames if identifier == step]
        assert frames[0][0] == session.protocol["ACK"].identifier and numbers == list(range(len(numbers)))
    monkeypatch.setattr(RunMemory, "FRAMES_MAX", 10)
    for _ in range(5):
        assert not memory.partial or memory.batches == []
        session.receive(0.1)
    assert memory.batches == [] and memory.partial
    session.listener = None

"""`plumb export`: each format holds the recording, units and time included, and no file is overwritten by accident."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import asammdf
import numpy as np
import pyarrow.parquet as parquet
import pytest

from plumb import __main__ as front
from plumb.readers.log_file import Frames
from plumb.readers.log_replay import RecordedRun, open_log, runs_of
from plumb.spec import dbc
from plumb.spec.protocol import protocol
from plumb.writers import log_export
from support.recordings import recorded_run, with_frames


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_run(tmp_path_factory.mktemp("log") / "whole.plog", setpoint=1 << 28)


@pytest.fixture(scope="module")
def recorded(whole: Path) -> RecordedRun:
    return runs_of(open_log(whole))[0]


def export(*arguments: object) -> int:
    return front.main(["export", *map(str, arguments)])


def test_a_csv_has_time_and_units(whole: Path, recorded: RecordedRun, tmp_path: Path) -> None:
    assert export(whole, tmp_path / "run.csv") == 0
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:4] == ["time_s", "step", "digest", "armed"]
    run = recorded.run
    assert len(rows) == run.steps
    for step, row in enumerate(rows):
        assert float(row["time_s"]) == pytest.approx(0.02 * step, abs=1e-6) and int(row["step"]) == step
        assert int(row["digest"], 16) == run.digest[step] and int(row["setpoint"]) == run.setpoint[step]
        assert [int(row[f"raw_{name}_counts"]) for name in ("gyro", "accel_y", "accel_z")] == run.raw[step, :3].tolist()
    # The default calibration at rest: no rate, level, 1 g; a count is 1.2 deg/s, and 1 mg.
    rest = next(row for row in rows if row["raw_gyro_counts"] == "1676")
    assert abs(float(rest["gyr_x_dps"])) < 0.61
    assert abs(float(rest["acc_y_g"])) < 0.002 and abs(float(rest["acc_z_g"]) - 1.0) < 0.002


def test_a_parquet_file_has_the_same_columns_with_units_and_origin(whole: Path, tmp_path: Path) -> None:
    assert export(whole, tmp_path / "run.parquet", tmp_path / "run.csv") == 0
    table = parquet.read_table(tmp_path / "run.parquet")
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        head, *rows = list(csv.reader(file))
    assert table.column_names == head and table.num_rows == len(rows)
    assert table.column("tilt_deg").to_pylist() == pytest.approx([float(row[head.index("tilt_deg")]) for row in rows])
    metadata = table.schema.field("tilt_deg").metadata
    assert metadata == {b"unit": b"deg"}
    said = json.loads(table.schema.metadata[b"plumb"])
    assert said["command"] == "a test" and said["parameters"][0]["values"]["system"] == 0


def test_a_value_that_neither_came_nor_can_be_calculated_is_an_empty_cell_and_a_null(
    whole: Path, recorded: RecordedRun, tmp_path: Path
) -> None:
    """The value of step 3 alone is lost: its counts say it. The counts of step 5 are lost: nothing says the value of
    step 7."""
    angle, raw = (protocol()[name].identifier for name in ("QUAD_ANGLE", "RAW_A"))

    def without_some(frames: Frames) -> Frames:
        angles, counts = (np.flatnonzero(frames["can_id"] == identifier) for identifier in (angle, raw))
        return np.delete(frames, [angles[3], counts[5], angles[7]])

    log = open_log(with_frames(whole, tmp_path / "run.plog", without_some))
    (lost,) = runs_of(log)
    log_export.export(log, lost, tmp_path / "run.csv")
    log_export.export(log, lost, tmp_path / "run.parquet")
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        cells = [row["tilt_deg"] for row in csv.DictReader(file)]
    assert [number for number, cell in enumerate(cells) if not cell] == [7]
    integers, _ = recorded.run.together.signal(("QUAD_ANGLE", "tilt"))
    assert float(cells[3]) == pytest.approx(360.0 * integers[3] / 2**32, rel=1e-6) and integers[3]
    column = parquet.read_table(tmp_path / "run.parquet").column("tilt_deg").to_pylist()
    assert [number for number, cell in enumerate(column) if cell is None] == [7]


def test_an_mf4_file_has_frames_signals_units_and_the_dbc(whole: Path, recorded: RecordedRun, tmp_path: Path) -> None:
    assert export(whole, tmp_path / "run.mf4") == 0
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        tilt = file.get("tilt_deg")
        assert tilt.unit == "deg" and len(tilt.samples) == recorded.run.steps
        assert np.allclose(np.diff(tilt.timestamps), 0.02)
        attached = [file.extract_attachment(index)[0] for index in range(len(file.attachments))]
        assert dbc.text() in [one if isinstance(one, str) else bytes(one).decode() for one in attached]
        # What any ASAM tool makes of the frames and a DBC is what plumb wrote as signals.
        decoded = file.extract_bus_logging({"CAN": [(Path(__file__).parents[2] / "host/plumb/spec/messages.dbc", 0)]})
        assert np.allclose(decoded.get("QUAD_ANGLE.tilt").samples, tilt.samples)


PROGRAM = """
import sys
from plumb.__main__ import entry
try:
    entry()
finally:
    print([name for name in ("can", "asammdf", "pandas") if name in sys.modules])
"""


def test_a_command_loads_the_library_of_mf4_for_mf4_alone(whole: Path, recorded: RecordedRun, tmp_path: Path) -> None:
    """python-can would load it, and it pandas: most of the time of a command."""

    def loaded(name: str) -> str:
        command = [sys.executable, "-c", PROGRAM, "export", str(whole), str(tmp_path / name)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1]

    assert loaded("run.blf") == "['can']"
    assert loaded("run.mf4") == "['can', 'asammdf', 'pandas']"
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        assert len(file.get("tilt_deg").samples) == recorded.run.steps


def test_the_dbc_the_identity_and_the_page(whole: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"run.{suffix}" for suffix in ("dbc", "json", "html")]
    assert export(whole, *files) == 0
    assert files[0].read_text() == dbc.text()
    said = json.loads(files[1].read_text())
    assert said["command"] == "a test" and said["ended"]["ended"] == "done" and said["board"]["PARAMETER_COUNT"] > 100
    page = files[2].read_text()
    for text in ("whole.plog", "a test", "Raw counts", "raw_accel_y_counts", "Sensors in g", "tilt_deg", "CRC-32"):
        assert text in page, text


def test_the_summary_says_what_was_written(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export(whole, tmp_path / "run.csv", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["files"] == [str(tmp_path / "run.csv")] and (said["run"], said["runs"]) == (1, 1) and said["steps"] > 20


def test_a_file_that_exists_is_kept(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """None of the others is written either, and the log itself cannot be the output."""
    (tmp_path / "run.csv").write_text("of value")
    assert export(whole, tmp_path / "run.blf", tmp_path / "run.csv") == 2
    assert "run.csv exists: choose another name, or give --force" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert export(whole, tmp_path / "run.csv", "--force") == 0 and "time_s" in (tmp_path / "run.csv").read_text()
    assert export(whole, whole) == 2 and "the suffix names the format" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("run.xlsx", "the suffix names the format: .csv"), ("run", "the suffix names the format"),
        ("file/run.csv", "cannot write"), ("file/run.blf", "cannot write"), ("file/run.html", "cannot write"),
    ],
)  # fmt: skip
def test_what_cannot_be_written_is_one_sentence(
    whole: Path, tmp_path: Path, name: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert export(whole, tmp_path / name) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1


@pytest.mark.parametrize("name", ["photo.png", "nothing"])
def test_a_file_of_another_kind_is_refused_with_the_kinds(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(b"\x89PNG\r\n")
    assert export(tmp_path / name, tmp_path / "run.csv") == 2
    assert f"{name} holds no frames in a format that plumb reads (BLF, MF4" in capsys.readouterr().err
    assert not (tmp_path / "run.csv").exists()


@pytest.mark.parametrize(("module", "suffix"), [("pyarrow", "parquet"), ("asammdf", "mf4")])
def test_a_missing_library_is_one_sentence_that_names_its_extra(
    whole: Path, tmp_path: Path, module: str, suffix: str
) -> None:
    """Before a log is read, or a board recorded."""
    code = f"import sys; sys.modules['{module}'] = None; from plumb.__main__ import main; sys.exit(main(sys.argv[1:]))"
    for command in (
        ["export", str(whole), str(tmp_path / f"run.{suffix}")],
        ["record", "--board", "serial:/dev/none", "--out", str(tmp_path / "run"), "--format", suffix],
    ):
        done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True, check=False)
        assert done.returncode == 2 and f"[{suffix}]" in done.stderr and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_log_without_a_run_still_gives_its_frames(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bare.blf"
    empty = tmp_path / "empty.plog"
    from plumb.writers.log_writer import LogWriter

    with LogWriter(empty, {"command": "a test"}) as writer:
        writer.add([(0x7E1, bytes(8))], 1.0)
    assert export(empty, path, tmp_path / "empty.json") == 0 and path.stat().st_size
    capsys.readouterr()
    assert export(empty, tmp_path / "empty.csv") == 2
    assert "the one frame of empty.plog is not plumb's" in capsys.readouterr().err

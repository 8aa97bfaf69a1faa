"""Tables as loggers, phones and serial monitors write them: stamps, rows of units, counters, text between the rows."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.readers.imu_files import tables, text_files
from plumb.readers.imu_files.given import Given, parse
from plumb.readers.recording_files import G_MPS2, NOTHING

ROWS = np.array([[1.5, -2.25, 3.0, 0.25, -0.5, 1.0], [4.5, 5.25, -6.0, 0.125, 0.5, -1.0], [0.5, 1, 2, 0, 0.25, 1.5]])
SENSORS = [*(f"gyr_{c}_dps" for c in "xyz"), *(f"acc_{c}_g" for c in "xyz")]
PLAIN = ",".join(["time_s", *SENSORS])
STEP_S = 0.01


def rows(times: list[str], values: np.ndarray = ROWS, separator: str = ",") -> str:
    lines = [separator.join([at, *(f"{one:.12g}" for one in row)]) for at, row in zip(times, values, strict=True)]
    return "".join(f"{line}\n" for line in lines)


def read(path: Path, taken: list[str] | None = None, given: Given = NOTHING) -> tables.Columns:
    """Without the process that `recording_files.read` reads in."""
    with path.open("rb") as file:
        return tables.read(path.name, text_files.lines_of(path.name, file), given, [] if taken is None else taken)


def check(path: Path, step_s: float = STEP_S, given: Given = NOTHING) -> list[str]:
    taken: list[str] = []
    got = read(path, taken, given)
    assert np.diff(got["time_s"]) == pytest.approx(np.full(2, step_s), abs=1e-6)
    assert got["gyr"] == pytest.approx(ROWS[:, :3]) and got["acc"] == pytest.approx(ROWS[:, 3:])
    return taken


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "imu.txt"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    "stamps",
    [
        ["2026-03-04T23:59:59.995", "2026-03-05T00:00:00.005", "2026-03-05T00:00:00.015"],
        ["2026-03-04 12:00:00.10Z", "2026-03-04 12:00:00.11Z", "2026-03-04 12:00:00.12Z"],
        ["2026-03-04T12:00:00.10+02:00", "2026-03-04T11:00:00.11+01:00", "2026-03-04T10:00:00.12+00:00"],
        ["2026-03-04 12:00:00:100", "2026-03-04 12:00:00:110", "2026-03-04 12:00:00:120"],
        ["04.03.2026 12:00:00.100", "04.03.2026 12:00:00.110", "04.03.2026 12:00:00.120"],
        ["3/14/2026 11:59:59.995 AM", "3/14/2026 12:00:00.005 PM", "3/14/2026 12:00:00.015 PM"],
        ["23:59:59.995", "00:00:00.005", "00:00:00.015"],
    ],
)
@pytest.mark.parametrize("header", ["timestamp", "time_s", "YYYY-MO-DD HH-MI-SS_SSS"])
def test_stamps_are_dates_and_times_of_day(tmp_path: Path, stamps: list[str], header: str) -> None:
    taken = check(written(tmp_path, PLAIN.replace("time_s", header) + "\n" + rows(stamps)))
    assert taken[1] == f"time from {header!r} in date-time"


def test_a_column_in_seconds_goes_before_a_date(tmp_path: Path) -> None:
    header = "date,seconds_elapsed," + ",".join(SENSORS)
    text = rows([f"2026-03-04 12:00:0{i},{i * STEP_S}" for i in range(3)])
    check(written(tmp_path, header + "\n" + text))


def test_a_row_below_the_header_has_the_units(tmp_path: Path) -> None:
    header = "Time,GyroX,GyroY,GyroZ,AccX,AccY,AccZ\n[ms],[rad/s],[rad/s],[rad/s],[m/s^2],[m/s^2],[m/s^2]\n"
    values = ROWS * ([np.pi / 180.0] * 3 + [G_MPS2] * 3)
    check(written(tmp_path, header + rows(["0", "10", "20"], values)))


def test_a_row_of_units_does_not_change_those_of_the_header(tmp_path: Path) -> None:
    text = PLAIN + "\nms,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2\n"
    check(written(tmp_path, text + rows(["0", "0.01", "0.02"])))


def test_text_between_the_rows_is_left_out_and_counted(tmp_path: Path) -> None:
    lines = rows(["0", "0.01", "0.02"]).splitlines(keepends=True)
    text = "ready\n" + PLAIN + "\n" + lines[0] + "MPU6050 found\n" + PLAIN + "\n" + lines[1] + lines[2]
    taken = check(written(tmp_path, text))
    assert taken[-1] == "2 lines are no rows of numbers and are left out, the first is line 4"


def test_columns_are_separated_by_spaces(tmp_path: Path) -> None:
    text = " ".join(["time_s", *SENSORS]) + "\n" + rows(["0", "0.01", "0.02"], separator="   ")
    taken = check(written(tmp_path, text))
    assert "separator space" in taken[0]


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16-le", "utf-16-be", "utf-8"])
def test_no_encoding_stops_a_table(tmp_path: Path, encoding: str) -> None:
    header = ["Time (s)", *(f"Gyroscope {c} (°/s)" for c in "xyz"), *(f"ACCELEROMETER {c} (m/s²)" for c in "XYZ")]
    values = ROWS * ([1.0] * 3 + [G_MPS2] * 3)
    check(written(tmp_path, ",".join(header) + "\n" + rows(["0", "0.01", "0.02"], values), encoding))


def test_a_table_may_be_compressed(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes(gzip.compress((PLAIN + "\n" + rows(["0", "0.01", "0.02"])).encode(), mtime=0))
    check(path)


def test_a_magnetometer_is_read_as_it_is(tmp_path: Path) -> None:
    header = PLAIN + ",Magnetometer X (uT),Magnetometer Y (uT),Magnetometer Z (uT)\n"
    path = written(tmp_path, header + rows(["0", "0.01", "0.02"], np.hstack([ROWS, [[1.0, 2, 3]] * 3])))
    assert "mag from 'Magnetometer X (uT)', 'Magnetometer Y (uT)', 'Magnetometer Z (uT)' in ut" in check(path)
    assert read(path)["mag"] == pytest.approx(np.array([[1.0, 2, 3]] * 3))


def test_a_table_without_a_time_asks_for_its_rate(tmp_path: Path) -> None:
    lines = "".join(line.partition(",")[2] for line in rows(["0", "1", "2"]).splitlines(keepends=True))
    path = written(tmp_path, ",".join(SENSORS) + "\n" + lines)
    with pytest.raises(UsageError, match=r'names no time: give --units "time=1/100 s" for rows at 100 Hz'):
        read(path)
    check(path, given=parse("time=1/100 s", None, None))


XSENS = [f"{sensor}_{c}" for sensor in ("Gyr", "Acc") for c in "XYZ"]


@pytest.mark.parametrize(
    ("before", "times", "factor"),
    [
        ("// Update Rate: 100.0Hz\n", ["65534,", "65535,", "0,"], np.pi / 180.0),
        ("", ["7,4294967196", "8,0", "9,100"], np.pi / 180.0),
        ("DeviceTag:,D422CD\nOutputRate:,100Hz\n", ["7,4294957296", "8,0", "9,10000"], 1.0),
    ],
)
def test_counters_of_xsens_begin_again_at_0(tmp_path: Path, before: str, times: list[str], factor: float) -> None:
    header = ",".join(["PacketCounter", "SampleTimeFine", *XSENS])
    values = ROWS * ([factor] * 3 + [G_MPS2] * 3)
    check(written(tmp_path, before + header + "\n" + rows(times, values)))


def test_ros_messages(tmp_path: Path) -> None:
    vectors = [f"field.{name}.{c}" for name in ("angular_velocity", "linear_acceleration") for c in "xyz"]
    header = ",".join(["%time", "field.header.seq", "field.header.stamp", *vectors])
    values = ROWS * ([np.pi / 180.0] * 3 + [G_MPS2] * 3)
    times = [f"1,{i},{1_700_000_000_000_000_000 + i * 10_000_000}" for i in range(3)]
    check(written(tmp_path, header + "\n" + rows(times, values)))


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\x00" * 400, "is neither .npz nor readable CSV text: it begins with 00 00"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "it begins with 89 50 4e 47"),
        (gzip.compress(PLAIN.encode() * 99, mtime=0)[:60], "is damaged, or no table of text"),
        (PLAIN.encode(), "has a header in line 1 and no row below it"),
        (
            b"Time (s),Linear Acceleration x (m/s^2),Gyroscope x (rad/s)\n",
            "names a gyro and not an accelerometer; a line",
        ),
    ],
    ids=["zeros", "picture", "cut gzip", "header alone", "no accelerometer"],
)
def test_what_is_no_table_is_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=sentence):
        read(path)


def test_a_column_that_is_not_there_is_named_and_never_replaced(tmp_path: Path) -> None:
    path = written(tmp_path, PLAIN + "\n" + rows(["0", "0.01", "0.02"]))
    with pytest.raises(UsageError, match=r"line 1 has no column 'wx' that --columns names; its columns are 'time_s',"):
        read(path, given=parse(None, "gyr=wx wy wz", None))
    check(path, given=parse(None, "gyr=gyr_x_dps gyr_y_dps gyr_z_dps", None))


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (",".join(["0,5"] * 7), "line 2 has 14 values below a header of 7 columns; commas in numbers"),
        ("0,1,2,3,4,5,6,7", "line 2 has 8 values below a header of 7 columns; a name is missing"),
    ],
)
def test_a_row_that_is_wider_than_its_header_is_refused(tmp_path: Path, line: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        read(written(tmp_path, f"{PLAIN}\n{line}\n{line}\n"))


def test_a_separator_at_the_end_of_the_rows_changes_nothing(tmp_path: Path) -> None:
    check(written(tmp_path, PLAIN + "\n" + rows(["0", "0.01", "0.02"]).replace("\n", ",,\n")))


@pytest.mark.parametrize(
    ("time", "gyro", "accelerometer"),
    [("Zeit [s]", "Drehrate", "Beschleunigung"), ("Zeitstempel (s)", "Winkelgeschwindigkeit", "Beschleunigungssensor")],
)
def test_german_headers_and_decimal_commas(tmp_path: Path, time: str, gyro: str, accelerometer: str) -> None:
    columns = [f"{gyro} {c} [°/s]" for c in "XYZ"] + [f"{accelerometer} {c} [g]" for c in "XYZ"]
    text = ";".join([time, *columns]) + "\n" + rows(["0", "0.01", "0.02"], separator=";").replace(".", ",")
    check(written(tmp_path, text, "cp1252"))

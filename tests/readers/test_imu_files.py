"""Tables of IMU loggers are read as they come: content decides, and units stand in the header."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.readers import recording_files
from plumb.readers.imu_files import frames, given
from plumb.readers.recording import vertical
from plumb.readers.recording_files import G_MPS2

PLAIN = ["time_s", *(f"gyr_{c}_dps" for c in "xyz"), *(f"acc_{c}_g" for c in "xyz")]
ROWS = [(0.0, 1.5, -2.25, 3.0, 0.25, -0.5, 1.0), (0.01, 4.5, 5.25, -6.0, 0.125, 0.5, -1.0)]
DEG, MPS2 = np.pi / 180.0, G_MPS2
HEADERS = {
    "x-io": (
        ["Time (s)", *(f"Gyroscope {c} (deg/s)" for c in "XYZ"), *(f"Accelerometer {c} (g)" for c in "XYZ")],
        (1.0, 1.0, 1.0),
    ),
    "phyphox": (
        ["Time (s)", *(f"Gyroscope {c} (rad/s)" for c in "xyz"), *(f"Acceleration {c} (m/s^2)" for c in "xyz")],
        (1.0, DEG, MPS2),
    ),
    "AndroSensor": (
        [*(f"ACCELEROMETER {c} (m/s²)" for c in "XYZ"), *(f"GYROSCOPE {c} (rad/s)" for c in "XYZ"),
         "Time since start in ms "],
        (1e3, DEG, MPS2),
    ),
    "EuRoC": (
        ["#timestamp [ns]", *(f"w_RS_S_{c} [rad s^-1]" for c in "xyz"), *(f"a_RS_S_{c} [m s^-2]" for c in "xyz")],
        (1e9, DEG, MPS2),
    ),
}  # fmt: skip


def written(header: list[str], factors: tuple[float, float, float], separator: str = ",") -> str:
    lines = [separator.join(header)]
    for row in ROWS:
        values = [row[0] * factors[0], *(v * factors[1] for v in row[1:4]), *(v * factors[2] for v in row[4:])]
        if "time" in header[-1].lower():
            values = [*values[4:], *values[1:4], values[0]]
        lines.append(separator.join(f"{value:.12g}" for value in values))
    return "\n".join(lines) + "\n"


def check(path: Path, said: given.Given = recording_files.NOTHING) -> None:
    got = recording_files.read(path, given=said)
    want = np.array(ROWS)
    assert got["time_s"] == pytest.approx(want[:, 0])
    assert got["gyr"] == pytest.approx(want[:, 1:4]) and got["acc"] == pytest.approx(want[:, 4:])


@pytest.mark.parametrize("logger", HEADERS)
def test_units_of_a_header_are_obeyed(tmp_path: Path, logger: str) -> None:
    path = tmp_path / "imu.txt"
    path.write_text(written(*HEADERS[logger]), encoding="utf-8")
    check(path)


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_separators_decimal_commas_and_encodings_are_seen(tmp_path: Path, separator: str, encoding: str) -> None:
    path = tmp_path / "imu.dat"
    text = "# a note\n" + written(PLAIN, (1.0, 1.0, 1.0), separator).replace(".", ",")
    path.write_text(text, encoding=encoding)
    check(path)
    taken: list[str] = []
    recording_files.read(path, taken)
    assert taken[0] == f"table, header in line 2, separator {'tab' if separator == chr(9) else 'semicolon'}"


def test_a_column_without_a_unit_is_refused_with_how_to_mend_it(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text("time (s),gx,gy,gz,ax,ay,az\n0,0,0,0,0,0,1\n")
    with pytest.raises(UsageError, match=r"line 1: column 'gx' states no unit; give --units \"gyr=rad/s,acc=m/s2\" "):
        recording_files.read(path)


BARE = ["t", "wx", "wy", "wz", "ax", "ay", "az"]
BY_NAME = "time=t,gyr=wx wy wz,acc=ax ay az"


def test_columns_and_units_can_be_given(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(written(BARE, (1e6, DEG, MPS2)))
    check(path, given.parse("gyr=rad/s, acc=m/s2, time=us", BY_NAME, None))
    path.write_text(written(["t", "wx", "wy", "wz", "ax", "ay", "a z"], (1.0, 131.0, 16384.0)))
    check(path, given.parse("gyr=1/131 deg/s,acc=1/16384 g,time=s", "time=t,gyr=wx wy wz,acc=ax ay 'a z'", None))


def test_a_given_unit_stands_above_that_of_the_header(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(written(PLAIN, (1.0, DEG, 1.0)))
    check(path, given.parse("gyr=rad/s", None, None))


@pytest.mark.parametrize(
    ("frame", "gyr", "acc"),
    [
        ("flu", [1.5, -2.25, 3.0], [0.25, -0.5, 1.0]),
        ("frd", [1.5, 2.25, -3.0], [0.25, 0.5, -1.0]),
        ("android", [-2.25, -1.5, 3.0], [-0.5, -0.25, 1.0]),
        ("ios", [-2.25, -1.5, 3.0], [0.5, 0.25, -1.0]),
    ],
)
def test_a_frame_is_turned_to_front_left_up(tmp_path: Path, frame: str, gyr: list[float], acc: list[float]) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(written(PLAIN, (1.0, 1.0, 1.0)))
    got = recording_files.read(path, given=given.parse(None, None, frame))
    assert got["gyr"][0] == pytest.approx(gyr) and got["acc"][0] == pytest.approx(acc)


@pytest.mark.parametrize("frame", frames.FRAMES)
def test_a_reference_turns_with_its_frame(frame: str) -> None:
    q = np.random.default_rng(5).normal(size=(50, 4))
    up = vertical(q)
    columns = {"gyr": up, "acc": up, "ref_quat": q}
    got = frames.turned(columns, frame)
    assert vertical(got["ref_quat"]) == pytest.approx(got["gyr"])


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("gyr=turns", None), r"'turns' is no unit of gyr; it has rad/s, deg/s, mdps"),
        (("gyr=1/0 deg/s", None), r"is no unit of gyr"),
        (("spin=rad/s", None), r"--units: 'spin=rad/s' is not time=, gyr= or acc="),
        ((None, "gyr=wx wy"), r"--columns: gyr has 3 of them, not 2"),
        ((None, "gyr='wx wy wz"), r"a quote that does not end"),
    ],
)
def test_a_wrong_option_is_one_sentence(options: tuple[str | None, str | None], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        given.parse(*options, None)


def test_names_that_no_header_has_are_refused_with_what_the_file_begins_with(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(written(BARE, (1.0, 1.0, 1.0)))
    with pytest.raises(UsageError, match=r"begins with 't,wx,wy,wz,ax,ay,az': say .* --columns \"time=t,gyr=wx"):
        recording_files.read(path)

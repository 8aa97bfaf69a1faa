"""Folders and zips of one table a sensor, and what microcontrollers print: read without editing."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.readers import recording_files
from plumb.readers.imu_files import table_sets, tables, text_files
from plumb.readers.imu_files.given import Given, parse
from plumb.readers.recording_files import G_MPS2, NOTHING

GRAVITY = np.array([1.0, -2.0, 9.0])


def table(header: str, at_s: np.ndarray, values: np.ndarray, before: str = "") -> bytes:
    rows = "".join(
        f"{before}{t:.6f}," + ",".join(f"{one:.9g}" for one in row) + "\n" for t, row in zip(at_s, values, strict=True)
    )
    return (header + "\n" + rows).encode()


def motion(at_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """rad/s and m/s2 that are lines in time, so that drawing lines between samples is exact."""
    return np.outer(at_s, [0.1, -0.2, 0.3]) + 0.5, np.outer(at_s, [1.0, 2.0, -1.0]) + GRAVITY


GYR_S, ACC_S = np.arange(200) * 0.01, 0.0033 + np.arange(110) * 0.02
LOGGER = "time,seconds_elapsed,z,y,x"


def sensor_logger(*, total: bool = True, gravity: bool = True) -> dict[str, bytes]:
    def one(at_s: np.ndarray, values: np.ndarray) -> bytes:
        return table(LOGGER, at_s, values[:, ::-1], "1700000000000000000,")

    files = {"Gyroscope.csv": one(GYR_S, motion(GYR_S)[0]), "Accelerometer.csv": one(ACC_S, motion(ACC_S)[1] - GRAVITY)}
    files |= {"TotalAcceleration.csv": one(ACC_S, motion(ACC_S)[1])} if total else {}
    files |= {"Gravity.csv": one(ACC_S, np.tile(GRAVITY, (len(ACC_S), 1)))} if gravity else {}
    other = np.full((len(GYR_S), 3), 99.0)
    files |= {"Metadata.csv": b"version,device name\n3,phone\n", "WatchGyroscope.csv": one(GYR_S, other)}
    return files | {"Magnetometer.csv": one(ACC_S, np.tile([1.0, 2.0, 3.0], (len(ACC_S), 1)))}


def phyphox() -> dict[str, bytes]:
    names = {"Gyroscope.csv": ("Gyroscope", "rad/s"), "Accelerometer.csv": ("Acceleration", "m/s^2"),
             "Linear Acceleration.csv": ("Linear Acceleration", "m/s^2")}  # fmt: skip
    files = {}
    for name, (quantity, unit) in names.items():
        header = ",".join(['"Time (s)"', *(f'"{quantity} {c} ({unit})"' for c in "xyz")])
        at_s = GYR_S if quantity == "Gyroscope" else ACC_S
        files[name] = table(header, at_s, motion(at_s)[0 if quantity == "Gyroscope" else 1])
    return {**files, "meta/device.csv": b"property,value\nversion,1.1\n"}


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def read(files: dict[str, bytes], taken: list[str] | None = None) -> tables.Columns:
    members = {name: lambda data=data: io.BytesIO(data) for name, data in files.items() if "/" not in name}
    return table_sets.read("walk", members, NOTHING, [] if taken is None else taken)


def check(got: tables.Columns) -> None:
    at_s = GYR_S[1:]  # the first comes before every sample of the accelerometer
    rate, accel = motion(at_s)
    assert got["time_s"] == pytest.approx(at_s)
    assert got["gyr"] == pytest.approx(np.degrees(rate), rel=1e-5)
    assert got["acc"] == pytest.approx(accel / G_MPS2, rel=1e-5)


@pytest.mark.parametrize(("total", "gravity"), [(True, True), (True, False), (False, True)])
def test_sensor_logger(total: bool, gravity: bool) -> None:
    taken: list[str] = []
    got = read(sensor_logger(total=total, gravity=gravity), taken)
    check(got)
    assert got["mag"] == pytest.approx(np.tile([1.0, 2.0, 3.0], (len(got["mag"]), 1)))
    assert any(one.startswith("two clocks: 110 samples of ") for one in taken)
    assert total or "Accelerometer.csv lacks gravity: Gravity.csv is added to it" in taken


def test_phyphox() -> None:
    check(read(phyphox()))


def test_a_zip_and_a_folder_are_read_by_the_door_of_every_file(tmp_path: Path) -> None:
    check(recording_files.read(zipped(tmp_path / "a.zip", phyphox())))
    folder = tmp_path / "walk"
    folder.mkdir()
    for name, data in sensor_logger().items():
        (folder / name).write_bytes(data)
    check(recording_files.read(folder))


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ({"Gyroscope.csv": phyphox()["Gyroscope.csv"]}, "holds no table of an accelerometer; its files: Gyroscope.csv"),
        ({"hello.txt": b"hi"}, "holds no table of a gyro and an accelerometer"),
        ({"xl/workbook.xml": b"<x/>", "a.csv": b""}, "is a workbook of a spreadsheet"),
        ({"Gyroscope.csv": b"0" * (8 << 20), "a.csv": b"1"}, "holds no table"),
    ],
)
def test_a_set_that_lacks_a_sensor_is_one_sentence(tmp_path: Path, files: dict[str, bytes], sentence: str) -> None:
    with zipfile.ZipFile(zipped(tmp_path / "a.zip", files)) as archive, pytest.raises(UsageError, match=sentence):
        table_sets.read("a.zip", table_sets.of_zip(archive), NOTHING, [])


def test_a_zip_that_is_cut_is_one_sentence(tmp_path: Path) -> None:
    path = zipped(tmp_path / "walk.zip", phyphox())
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(UsageError, match=r"^walk\.zip is a damaged zip, perhaps cut"):
        recording_files.read(path)


def test_a_set_of_several_recordings_is_one_sentence() -> None:
    text = b"Time (s)," + b",".join(f"{s} {c}".encode() for s in ("gyr", "acc") for c in "xyz") + b"\n"
    with pytest.raises(UsageError, match=r"holds several recordings: a.csv, b.csv: give one of them"):
        read({"a.csv": text, "b.csv": text})


def of_text(text: str, given: Given = NOTHING) -> tables.Columns:
    return tables.read("dump.txt", text_files.lines_of("dump.txt", io.BytesIO(text.encode())), given, [])


COUNTS = "time=1/100 s,gyr=1/131 deg/s,acc=1/16384 g"
GYR, ACC = np.array([1.0, 0.0, -2.0]), np.array([0.5, -1.0, 0.0])
LIBRARY = (
    "Acceleration X: 4.903325, Y: -9.80665, Z: 0.00 m/s^2\n"
    "Rotation X: 0.017453292, Y: 0.00, Z: -0.034906585 rad/s\nTemperature: 30 degC\n\n"
)
STAMPED = "Accel X: 0.5 g, Accel Y: -1 g, Accel Z: 0 g\tGyro X: 1 deg/s, Gyro Y: 0 deg/s, Gyro Z: -2 deg/s\n"
DUMPS = {
    "a library's example": ("MPU6050 test!\n\n" + LIBRARY * 3, "time=1/100 s"),
    "a bar between": (
        "AcX = 8192 | AcY = -16384 | AcZ = 0 | Tmp = 24.5 | GyX = 131 | GyY = 0 | GyZ = -262\n" * 3,
        COUNTS,
    ),
    "six counts": ("MPU6050 connection successful\n" + "a/g:\t8192\t-16384\t0\t131\t0\t-262\n" * 3, COUNTS),
    "a plotter's labels": ("ax:0.5,ay:-1,az:0,gx:1,gy:0,gz:-2\n" * 3, "time=1/100 s,gyr=deg/s,acc=g"),
    "a serial monitor's stamps": ("".join(f"12:00:00.{i}0 -> {STAMPED}" for i in "123"), None),
}


@pytest.mark.parametrize("name", DUMPS)
def test_what_a_microcontroller_prints(name: str) -> None:
    text, units = DUMPS[name]
    got = of_text(text, parse(units, None, None))
    step_s = 0.1 if units is None else 0.01
    assert got["time_s"] == pytest.approx(np.arange(3) * step_s, abs=1e-6)
    assert got["gyr"] == pytest.approx(np.tile(GYR, (3, 1)), rel=1e-6) and got["acc"] == pytest.approx(
        np.tile(ACC, (3, 1))
    )


@pytest.mark.parametrize("name", ["a bar between", "a library's example"])
def test_what_a_dump_does_not_say_is_asked_for(name: str) -> None:
    with pytest.raises(UsageError, match=r"names no time: give --units \"time=1/100 s\""):
        of_text(DUMPS[name][0])


def test_rows_of_numbers_alone_are_named_by_place() -> None:
    text = "ready\n" + "8192,-16384,0,131,0,-262\n" * 3
    with pytest.raises(UsageError, match=r'has rows without a header; .* --columns "acc=1 2 3,gyr=4 5 6"'):
        of_text(text)
    got = of_text(text, parse(COUNTS, "acc=1 2 3,gyr=4 5 6", None))
    assert got["gyr"] == pytest.approx(np.tile([1.0, 0.0, -2.0], (3, 1))) and len(got["time_s"]) == 3


@pytest.mark.parametrize("separator", [",", "\t", " ", ", ", ";"])
def test_a_serial_monitors_stamps_before_bare_numbers_are_the_time(separator: str) -> None:
    row = separator.join(["8192", "-16384", "0", "131", "0", "-262"])
    ready, text = "12:00:00.000 -> ready\n", "".join(f"12:00:00.{i}0 -> {row}\n" for i in "123")
    counts = "gyr=1/131 deg/s,acc=1/16384 g"
    got = of_text(ready + text, parse(counts, "acc=1 2 3,gyr=4 5 6", None))
    assert got["time_s"] == pytest.approx(np.arange(3) * 0.1, abs=1e-6)
    assert got["gyr"] == pytest.approx(np.tile(GYR, (3, 1))) and got["acc"] == pytest.approx(np.tile(ACC, (3, 1)))
    names = separator.join(["ax", "ay", "az", "gx", "gy", "gz"])
    headed = of_text(f"{ready}12:00:00.000 -> {names}\n{text}", parse(counts, None, None))
    assert all(np.array_equal(headed[one], values) for one, values in got.items())

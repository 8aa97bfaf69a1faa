"""Tables of programs that are known by their headers have the units that those programs write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb.errors import UsageError
from plumb.readers import recording_files
from plumb.readers.imu_files.given import parse
from plumb.readers.recording_files import G_MPS2

TIME_S = [0.0, 0.01, 0.02]
GYR_DPS = np.array([[1.5, -2.25, 3.0], [4.5, 5.25, -6.0], [0.5, 1.0, 2.0]])
ACC_G = np.array([[0.25, -0.5, 1.0], [0.125, 0.5, -1.0], [0.0, 0.25, 1.5]])
RADPS, MPS2 = np.radians(GYR_DPS), ACC_G * G_MPS2


def table(header: str, columns: Sequence[npt.ArrayLike], separator: str = ",") -> str:
    rows = np.column_stack([np.asarray(one) for one in columns])
    return "\n".join([header, *(separator.join(f"{value:.12g}" for value in row) for row in rows)]) + "\n"


def check(folder: Path, text: str, first: float = 0.0) -> tuple[dict[str, np.ndarray], list[str]]:
    path, taken = folder / "imu.csv", []  # type: ignore[var-annotated]
    path.write_text(text)
    got = recording_files.read(path, taken)
    assert got["time_s"] - first == pytest.approx(TIME_S)
    assert got["gyr"] == pytest.approx(GYR_DPS) and got["acc"] == pytest.approx(ACC_G)
    return got, taken


def test_px4(tmp_path: Path) -> None:
    header = (
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt"
    )
    same = np.full(3, 4000.0)
    time_us = 5e6 + 1e6 * np.array(TIME_S)
    _, taken = check(tmp_path, table(header, [time_us, RADPS, same, 0.0 * same, MPS2, same]), 5.0)
    assert taken[0].startswith("PX4, header in line 1") and "--frame frd" in taken[-1]


BLACKBOX = "loopIteration,time (us),axisP[0]," + ",".join(
    [*(f" gyroADC[{i}]" for i in range(3)), *(f" accSmooth[{i}]" for i in range(3))]
)


@pytest.mark.parametrize(
    ("before", "counts", "said"),
    [
        ("", 2048.0, "acc_1G is not named: 2048 counts/g are assumed"),
        ('"acc_1G","4096"\n', 4096.0, "4096 counts/g, as named"),
    ],
)
def test_blackbox_decode(tmp_path: Path, before: str, counts: float, said: str) -> None:
    columns = [np.arange(3), 1e6 * np.array(TIME_S), np.zeros(3), GYR_DPS, counts * ACC_G]
    _, taken = check(tmp_path, before + table(BLACKBOX, columns))
    assert taken[0].startswith("blackbox_decode") and said in taken[-1]


def test_blackbox_decode_with_units_in_its_header(tmp_path: Path) -> None:
    header = BLACKBOX.replace("]", "] (m/s/s)").replace("axisP[0] (m/s/s)", "axisP[0]")
    for i in range(3):
        header = header.replace(f"gyroADC[{i}] (m/s/s)", f"gyroADC[{i}] (rad/s)")
    check(tmp_path, table(header, [np.arange(3), 1e6 * np.array(TIME_S), np.zeros(3), RADPS, MPS2]))


ANDROSENSOR = (
    "GPS LATITUDE (degrees),TIME SINCE START (ms),"
    + ",".join(f"ACCELEROMETER {c} (m/s²) " for c in "XYZ")
    + ","
    + ",".join(f"GYROSCOPE {c} (rad/s)" for c in ("Yaw", "Pitch", "Roll"))
    + ","
    + ",".join(f"MAGNETIC FIELD {c} (μT)" for c in "XYZ")
    + ",ORIENTATION (Yaw) (°)"
)


def test_androsensor_whose_gyro_is_named_by_angles(tmp_path: Path) -> None:
    """Yaw is about z, pitch about x, roll about y of the device, as Android's orientation has them."""
    mag = np.tile([20.0, -5.0, 40.0], (3, 1))
    columns = [np.full(3, 52.4), 1e3 * np.array(TIME_S), MPS2, RADPS[:, [2, 0, 1]], mag, np.zeros(3)]
    got, taken = check(tmp_path, table(ANDROSENSOR, columns))
    assert got["mag"] == pytest.approx(mag)
    assert taken[0].startswith("AndroSensor, header in line 1") and "pitch, roll and yaw are taken as" in taken[-1]


XSENS = [f"Acc_{c}" for c in "XYZ"] + [f"Gyr_{c}" for c in "XYZ"] + [f"Quat_q{i}" for i in range(4)]
COMMENTS = "// Start Time: Unknown\n// Sample rate: 100.0Hz\n// Scenario: 4.9\n"


def test_xsens(tmp_path: Path) -> None:
    quat = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 0.6, 0.8]])
    header = "\t".join(["PacketCounter", "SampleTimeFine", *XSENS])
    columns = [np.arange(3), 1e4 * np.array(TIME_S), MPS2, RADPS, quat]
    got, _ = check(tmp_path, COMMENTS + table(header, columns, "\t"))
    assert got["ref_quat"] == pytest.approx(quat)


def test_xsens_without_times_counts_packets(tmp_path: Path) -> None:
    header = "\t".join(["PacketCounter", *XSENS[:6]])
    columns = [np.arange(3), MPS2, RADPS]
    check(tmp_path, COMMENTS + table(header, columns, "\t"))
    (tmp_path / "imu.csv").write_text(table(header, columns, "\t"))
    with pytest.raises(UsageError, match=r'PacketCounter.* states no unit; give --units "time=s"'):
        recording_files.read(tmp_path / "imu.csv")
    got = recording_files.read(tmp_path / "imu.csv", given=parse("time=1/100 s", None, None))
    assert got["time_s"] == pytest.approx(TIME_S)

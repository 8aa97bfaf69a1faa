"""ULog files of PX4 are read as they come."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from plumb.errors import UsageError
from plumb.readers import recording_files
from plumb.readers.imu_files import ulog
from plumb.readers.recording_files import G_MPS2

COMBINED = "uint64_t timestamp;float[3] gyro_rad;uint32_t dt;float[3] accelerometer_m_s2;uint8_t[4] _padding0;"
ATTITUDE = "uint64_t timestamp;float[4] q;"
RATE, ACCEL, QUAT = (0.5, -0.25, 1.0), (1.0, 2.0, -9.0), (0.6, 0.0, 0.8, 0.0)


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def file_of(count: int = 3, combined: str = COMBINED) -> bytes:
    """Two instances of sensor_combined, of which the first counts."""
    data = ulog.MAGIC + bytes(9) + message("B", bytes(40))
    data += message("F", b"sensor_combined:" + combined.encode()) + message(
        "F", b"vehicle_attitude:" + ATTITUDE.encode()
    )
    for number, (instance, topic) in enumerate(
        [(0, "sensor_combined"), (0, "vehicle_attitude"), (1, "sensor_combined")]
    ):
        data += message("A", struct.pack("<BH", instance, number) + topic.encode())
    for i in range(count):
        sample = struct.pack("<Q3fI3f", 5_000_000 + 4000 * i, *RATE, 4000, *ACCEL)
        data += message("D", struct.pack("<H", 0) + sample) + message("D", struct.pack("<H", 2) + bytes(len(sample)))
        data += message("D", struct.pack("<HQ4f", 1, 5_002_000 + 4000 * i, *QUAT)) + message("L", b"text")
    return data


def test_sensors_and_attitude(tmp_path: Path) -> None:
    path, taken = tmp_path / "flight.bin", list[str]()
    path.write_bytes(file_of())
    got = recording_files.read(path, taken)
    assert got["time_s"] == pytest.approx(5.0 + 0.004 * np.arange(3))
    assert got["gyr"] == pytest.approx(np.tile(np.degrees(RATE), (3, 1)))
    assert got["acc"] == pytest.approx(np.tile(np.array(ACCEL) / G_MPS2, (3, 1)))
    assert np.isnan(got["ref_quat"][0]).all() and got["ref_quat"][1:] == pytest.approx(np.tile(QUAT, (2, 1)))
    assert taken[0].startswith("ULog, sensor_combined")


def test_a_cut_file_is_read_up_to_its_last_message(tmp_path: Path) -> None:
    path, taken = tmp_path / "flight.ulg", list[str]()
    path.write_bytes(file_of()[:-87])
    assert len(ulog.read(path, taken)["time_s"]) == 2 and taken[-1] == "the last message is cut: read up to it"


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (ulog.MAGIC + bytes(9), "has no sensor_combined; its topics: none"),
        (
            file_of(combined="uint64_t timestamp;float[2] gyro_rad;float[3] accelerometer_m_s2;"),
            "has no field gyro_rad of 3",
        ),
        (file_of(combined="uint64_t timestamp;strange gyro_rad;"), "is damaged: its format"),
        (file_of(combined=COMBINED + "".join(f"double[256] f{i};" for i in range(40))), "is longer than a message"),
    ],
)
def test_a_damaged_file_is_one_sentence(tmp_path: Path, data: bytes, sentence: str) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(data)
    with pytest.raises(UsageError, match=sentence):
        ulog.read(path, [])

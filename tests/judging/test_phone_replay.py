"""Files of a phone, replayed: in units with a reference, and datagrams as they were saved."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from support.phone_datagrams import G, run_of, sensorstream


def test_a_recording_with_a_reference_is_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file's quaternion says where up is; the estimate is scored against it where the file says movement."""
    run = run_of()
    x, y, z = run.vertical
    quat = np.stack([1.0 + z, y, -x, np.zeros_like(x)], 1)  # the shortest turn that takes z to the vertical's place
    path = tmp_path / "walk.npz"
    np.savez(path, gyr=np.radians(run.sensed_dps.T), acc=run.sensed_g.T * G, rate_hz=100.0, ref_quat=quat)
    assert front.main(["replay", str(path), "--system", "phone", "--board", "native", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["verdict"] == "pass" and answer["scored_steps"] > 1000
    assert answer["metrics"]["angle_rmse_deg"] < 1.0 < answer["metrics"]["accel_only_rmse_deg"]


def test_a_file_that_makes_no_step_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "udp.txt"
    path.write_text("A, 1, 1384532190123, 0.1, 0.2, 9.8\nA, 2, 1384532190133, 0.1, 0.2, 9.8\n")
    assert front.main(["replay", str(path), "--system", "phone", "--board", "native"]) == 2
    assert "no gyroscope" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option", [("--period-us", "0"), ("--seconds", "0"), ("--seconds", "nan"), ("--seconds", "-1")]
)
def test_a_file_is_replayed_only_at_a_period_and_for_a_time_that_can_be(
    option: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "walk.txt"
    path.write_bytes(b"\n".join(sensorstream(run_of())[:200]))
    assert front.main(["replay", str(path), "--system", "phone", "--board", "native", *option]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_datagrams_are_not_decimated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "walk.txt"
    path.write_text("of some app\n")
    assert front.main(["replay", str(path), "--system", "phone", "--board", "native", "--decimate", "3"]) == 2
    assert "--decimate is for recordings in .npz and .csv" in capsys.readouterr().err

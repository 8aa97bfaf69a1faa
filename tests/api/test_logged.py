"""plumb.load of a log: arrays in units, as the CSV has them, and the replay that `plumb replay` does."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb import __main__ as front
from plumb import systems
from plumb.readers.log_file import Frames
from plumb.spec.protocol import protocol
from support.recordings import GAINS, recorded_run, with_frames

STEER = 1 << 28


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "today.plog"
    return recorded_run(path, setpoint=STEER, changes=[GAINS])


def loaded(path: Path) -> plumb.LoggedRun:
    run = plumb.load(path)
    assert isinstance(run, plumb.LoggedRun)
    return run


def test_a_log_is_arrays_in_units_with_time(log: Path, tmp_path: Path) -> None:
    run = loaded(log)
    assert (run.system, run.run, run.runs, run.warnings) == ("quad", 1, 1, [])
    assert run.known == len(run.time_s) == len(run.step) > 30 and run.time_s[1] - run.time_s[0] == pytest.approx(0.02)
    assert run.units["tilt_deg"] == "deg" and run.units["raw_gyro_counts"] == "counts"
    assert np.array_equal(run.gyr_radps[:, 0], np.radians(run.signals["gyr_x_dps"]))
    assert np.array_equal(run.acc_mps2[:, 2], 9.80665 * run.signals["acc_z_g"])
    assert np.isnan(run.gyr_radps[:, 1:]).all() and np.isnan(run.acc_mps2[:, 0]).all(), "quad does not measure these"
    assert run.truth is None and run.movement.all() and not run.armed.any()
    assert front.main(["export", str(log), str(tmp_path / "run.csv")]) == 0
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["digest"], 16) for row in rows] == run.digest.tolist()
    assert np.array_equal(run.signals.gyr_x_radps, np.radians(run.signals["gyr_x_dps"]))
    for name, values in run.signals.items():
        written = [float(row[name]) if row[name] else math.nan for row in rows]
        assert np.allclose(written, values, rtol=1e-8, equal_nan=True), name


def test_the_parameters_and_their_change_are_in_units(log: Path) -> None:
    run = loaded(log)
    ((step, changed),) = run.changes.items()
    assert 0 < step < len(run.time_s) and set(changed) == {"pid.kp_per_deg", "pid.ki_per_deg_s", "pid.kd_per_dps"}
    assert all(run.parameters[name] != value for name, value in changed.items())


def test_a_replay_is_that_of_the_log(log: Path) -> None:
    run = loaded(log)
    result = run.replay()
    assert result.verdict == "pass" and result.bit_exact and result.steps == run.known
    assert run.replay("quad", seconds=0.2).steps == 10
    for wrong in (
        {"system": systems.with_part("replay")[-1]},
        {"axis": "y"},
        {"period_s": 0.01},
        {"seconds": "long"},
        {"board": 3},
    ):
        with pytest.raises(plumb.UsageError):
            run.replay(**wrong)


def test_a_log_that_lost_a_frame_is_unverified(log: Path, tmp_path: Path) -> None:
    """Here its first counts."""
    raw = protocol()["RAW_A"].identifier

    def without_one(frames: Frames) -> Frames:
        return np.delete(frames, np.flatnonzero(frames["can_id"] == raw)[9])

    run = loaded(with_frames(log, tmp_path / "lost.plog", without_one))
    assert run.known == 9 and run.replay().verdict == "unverified"
    assert np.flatnonzero(np.isnan(run.signals["raw_gyro_counts"])).tolist() == [9]


@pytest.mark.parametrize("suffix", ["blf", "asc", "log", "trc"])
def test_files_of_frames_are_loaded_too(log: Path, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    assert front.main(["export", str(log), str(path)]) == 0
    run, whole = loaded(path), loaded(log)
    assert np.array_equal(run.digest, whole.digest) and run.changes == whole.changes
    assert all(np.array_equal(run.signals[name], values, equal_nan=True) for name, values in whole.signals.items())


def test_what_cannot_be_loaded_is_a_sentence(log: Path, tmp_path: Path) -> None:
    (tmp_path / "none.plog").write_bytes(b"plumb log 1\n")
    np.savez(tmp_path / "units.npz", gyr=np.zeros((500, 3)), acc=np.ones((500, 3)), rate_hz=100.0)
    for path, more, sentence in (
        (tmp_path / "none.plog", {}, "holds no whole block"),
        (tmp_path / "gone.plog", {}, "No such file"),
        (log, {"run": 2}, "there is no run 2"),
        (log, {"run": 1.5}, "give a whole number"),
        (log, {"params": tmp_path / "gone.toml"}, "No such file"),
        (tmp_path / "units.npz", {"run": 1}, "run and params are for logs"),
    ):
        with pytest.raises(plumb.UsageError, match=sentence):
            plumb.load(path, **more)

"""Stamps that a batch shares are spread inside it, rows that are the same are dropped, and both are said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb import __main__ as front
from plumb.errors import UsageError
from plumb.readers import recording
from support.imu_recordings import in_the_hand


def table(folder: Path, rows: np.ndarray) -> Path:
    path = folder / "imu.csv"
    header = "time_s," + ",".join([*(f"gyr_{c}_dps" for c in "xyz"), *(f"acc_{c}_g" for c in "xyz")])
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def good(seed: int) -> np.ndarray:
    samples = in_the_hand(seed, 100, 20.0)
    return np.column_stack([samples.time_s, samples.gyr_dps, samples.acc_g])


@pytest.mark.parametrize("batch", [2, 3, 10])
def test_a_batch_is_spread_to_the_next_stamp(tmp_path: Path, batch: int) -> None:
    rows = good(1)
    want = rows[:, 0].copy()
    rows[:, 0] = np.repeat(want[::batch], batch)[: len(rows)]
    got = recording.load(table(tmp_path, rows))
    assert got.time_s == pytest.approx(want, abs=1e-6)
    (said,) = got.notes
    assert said.startswith(f"{len(rows) - len(want[::batch])} of {len(rows)} stamps")


def test_rows_that_are_the_same_are_dropped_and_counted(tmp_path: Path) -> None:
    rows = good(2)
    drawn = np.sort(np.random.default_rng(3).choice(len(rows), 37, replace=False))
    path = table(tmp_path, np.insert(rows, drawn, rows[drawn], axis=0))
    with pytest.warns(UserWarning, match=rf"imu.csv: 37 of {len(rows) + 37} rows are dropped"):
        got = plumb.load(path)
    assert isinstance(got, plumb.Recording)
    assert np.degrees(got.gyr_radps) == pytest.approx(rows[:, 1:4]) and len(got.time_s) == len(rows)


def test_a_clock_that_never_steps_is_refused(tmp_path: Path) -> None:
    rows = good(4)
    rows[:, 0] = 7.0
    with pytest.raises(UsageError, match="time stands still"):
        recording.load(table(tmp_path, rows))


def test_check_reports_what_replay_mends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = good(5)
    rows[:, 0] = np.repeat(rows[::2, 0], 2)
    path = str(table(tmp_path, np.insert(rows, 8, rows[8], axis=0)))
    assert front.main(["check", path, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["as_found"] == ["rows:new", "time:spread"]
    assert front.main(["replay", path, "--system", "attitude", "--board", "native", "--seconds", "3", "--json"]) == 0
    said = capsys.readouterr().err
    assert "1 of 2001 rows are dropped" in said and "each batch is spread" in said

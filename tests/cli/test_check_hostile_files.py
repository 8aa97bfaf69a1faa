"""`plumb check` of samples that say nothing: one sentence, and the exit code of a file that cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest

from plumb.__main__ import main

HEADER = "time_s,gyr_x_dps,gyr_y_dps,gyr_z_dps,acc_x_g,acc_y_g,acc_z_g\n"


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("{at},nan,0,0,0,0,1\n", "only 0 of 300 rows have no value that is missing"),
        ("{at},0,0,inf,0,0,1\n", "only 0 of 300 rows have no value that is missing"),
        ("{at},0,0\n", "only 0 of 300 rows have no value that is missing"),
        ("0,0,0,0,0,0,1\n", "all of 300 rows are the same, stamp and samples"),
    ],
)
def test_nothing_to_audit(tmp_path: Path, capsys: pytest.CaptureFixture[str], row: str, sentence: str) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(HEADER + "".join(row.format(at=0.01 * i) for i in range(300)))
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert f"imu.csv: {sentence}" in said and said.count("\n") == 1


def test_an_accelerometer_of_zeros(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(HEADER + "".join(f"{0.01 * i},0,0,0,0,0,0\n" for i in range(300)))
    assert main(["check", str(path)]) == 1
    assert "the accelerometer reads nothing" in capsys.readouterr().out


def test_too_few_samples_are_not_called_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(HEADER + "0,0,0,0,0,0,1\n0.01,0,0,0,0,0,1\n")
    assert main(["check", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "nothing can be told: too few samples"

"""`plumb check` says what is wrong with a file, exits by what is sure, and mends it for other commands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.audit.samples import Samples
from plumb.readers.recording import G_MPS2
from support.imu_recordings import in_the_hand, spoilt


def saved(folder: Path, samples: Samples) -> str:
    path = folder / "walk.npz"
    assert samples.ref_quat is not None
    np.savez(
        path,
        time_s=samples.time_s,
        gyr=np.radians(samples.gyr_dps),
        acc=samples.acc_g * G_MPS2,
        ref_quat=samples.ref_quat,
    )
    return str(path)


def test_a_good_file_exits_with_0(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["check", saved(tmp_path, in_the_hand(3, 100, 20.0))]) == 0
    assert capsys.readouterr().out.endswith("nothing is wrong\n")


def test_what_is_sure_exits_with_1_and_is_undone_as_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(tmp_path, spoilt(in_the_hand(4, 100, 20.0), ("gyro-radps", "ms"), 4))
    assert front.main(["check", path, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["as_found"] == ["time*0.001", "gyr*57.2958"]
    assert front.main(["check", path, "--as-found"]) == 0
    assert "as found: time*0.001 gyr*57.2958" in capsys.readouterr().out


def test_what_is_likely_is_named_and_not_applied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(tmp_path, spoilt(in_the_hand(5, 100, 20.0), ("acc-sign",), 5))
    assert front.main(["check", path, "--as-found"]) == 0
    said = capsys.readouterr().out
    assert "! accelerometer-sign: likely" in said and "[--mend acc*-1, or --mend ref:ned]" in said
    assert front.main(["check", path, "--mend", "acc*-1"]) == 0
    assert capsys.readouterr().out.endswith("nothing is wrong\n")


def test_an_estimate_of_a_mended_file_is_that_of_the_good_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = in_the_hand(6, 100, 20.0)
    errors = []
    for samples, more in ((good, []), (spoilt(good, ("acc-g", "gyro-swapped"), 6), ["--as-found"])):
        path = saved(tmp_path, replace(samples))
        assert front.main(["replay", path, "--system", "attitude", "--board", "native", "--json", *more]) == 0
        errors.append(json.loads(capsys.readouterr().out)["metrics"]["angle_rmse_deg"])
    assert errors[1] == pytest.approx(errors[0], abs=0.02)


def test_a_word_that_is_no_mend_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["check", saved(tmp_path, in_the_hand(7, 100, 20.0)), "--mend", "gyr*0"]) == 2
    assert "give a number that is not 0" in capsys.readouterr().err


def test_the_page_has_the_finding(tmp_path: Path) -> None:
    path = saved(tmp_path, spoilt(in_the_hand(8, 100, 20.0), ("gyro-mirrored",), 8))
    assert front.main(["check", path, "--out", str(tmp_path / "page")]) == 1
    assert "gyro -y follows accelerometer y" in (tmp_path / "page/report.html").read_text(encoding="utf-8")


def test_what_was_taken_comes_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "walk.txt"
    good = in_the_hand(9, 100, 20.0)
    rows = np.column_stack([good.time_s, good.gyr_dps, good.acc_g])
    header = "t;gx;gy;gz;ax (g);ay (g);az (g)"
    np.savetxt(path, rows, delimiter=";", header=f"a note\n{header}", comments="")
    options = ["--units", "gyr=deg/s,time=s", "--frame", "flu"]
    assert front.main(["check", str(path), *options]) == 0
    assert capsys.readouterr().out.splitlines()[:5] == [
        "read: table, header in line 2, separator semicolon",
        "read: time from 't' in s by --units",
        "read: gyr from 'gx', 'gy', 'gz' in deg/s by --units",
        "read: acc from 'ax (g)', 'ay (g)', 'az (g)' in g",
        "read: axes flu: x front, y left, z up, as plumb has",
    ]
    front.main(["check", str(path), *options, "--json"])
    assert json.loads(capsys.readouterr().out)["taken"][0] == "table, header in line 2, separator semicolon"


@pytest.mark.parametrize("rows", [*range(2, 8), *range(18, 40)])
def test_a_file_of_a_few_rows_is_audited_as_far_as_it_goes(
    rows: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, in_the_hand(3, 100.0, 25.0).rows(np.arange(rows)))
    assert front.main(["check", path]) == 0
    assert f"{rows} samples" in capsys.readouterr().out


def test_a_file_of_one_row_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = saved(tmp_path, in_the_hand(3, 100.0, 25.0).rows(np.arange(1)))
    assert front.main(["check", path]) == 2
    assert "has 1 sample: an audit needs two" in capsys.readouterr().err

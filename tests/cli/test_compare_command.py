"""`plumb compare`: what it prints and writes, and one sentence for what cannot be compared."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front


def swing(folder: Path, name: str = "swing.npz", **changed: object) -> str:
    """A made-up recording: tilting about x, with its reference."""
    time_s = np.arange(1500) / 100.0
    tilt = np.radians(20.0) * np.sin(2.0 * np.pi * 0.3 * time_s)
    zero = np.zeros_like(tilt)
    columns: dict[str, object] = {
        "gyr": np.column_stack([np.diff(tilt, prepend=0.0) * 100.0, zero, zero]),
        "acc": 9.80665 * np.column_stack([zero, np.sin(tilt), np.cos(tilt)]),
        "ref_quat": np.column_stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero]),
        "rate_hz": np.float64(100.0),
    }
    path = folder / name
    np.savez(path, **{key: value for key, value in {**columns, **changed}.items() if value is not None})  # type: ignore[arg-type]
    return str(path)


@pytest.fixture(autouse=True)
def packages() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")


def test_json_has_every_algorithm_on_every_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [swing(tmp_path), swing(tmp_path, "again.npz")]
    options = ["--decimate", "1", "--decimate", "3", "--grade", "recorded", "--grade", "bias", "--json"]
    assert front.main(["compare", *files, *options]) == 0
    report = json.loads(capsys.readouterr().out)
    names = [one["name"] for one in report["algorithms"]]
    assert names[:4] == ["VQF", "BasicVQF", "Madgwick", "Mahony"] and len(names) > 4
    assert [one["origin"].split()[0] for one in report["algorithms"][:4]] == ["vqf", "vqf", "AHRS", "AHRS"]
    assert [(one["grade"], one["decimate"]) for one in report["inputs"]] == [
        ("recorded", 1), ("recorded", 3), ("bias", 1), ("bias", 3),
    ]  # fmt: skip
    assert [one["input"] for one in report["inputs"]] == ["recorded", "recorded/3", "bias", "bias/3"]
    assert "VQF" in report["inputs"][2]["outside"] and not report["inputs"][0]["outside"]
    for one in report["inputs"]:
        seeds = [1, 2] if one["grade"] == "bias" else [0]
        keys = [(row["recording"], row["seed"], row["algorithm"]) for row in one["rows"]]
        can = [name for name in names if name != "attitude" or one["decimate"] == 1]  # which cannot have 30 ms
        assert keys == [(file, seed, name) for file in ("swing", "again") for seed in seeds for name in can]
        assert list(one["means_deg"]) == can
        for name in can:
            own = [row["rmse_deg"] for row in one["rows"] if row["algorithm"] == name]
            assert one["means_deg"][name]["rmse_deg"] == pytest.approx(np.mean(own))
            assert one["means_deg"][name]["worst_rmse_deg"] == max(own)
        assert one["means_deg"]["VQF"]["sigma_deg"] is None
        assert one["decimate"] > 1 or one["means_deg"]["attitude"]["sigma_deg"] > 0.0


def test_table_and_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["compare", swing(tmp_path), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("Mean tilt error (deg)\n  input ") and "gain 0.033" in printed
    assert "\nSigma against error\n" in printed
    assert printed.rstrip().endswith(f"report: {tmp_path / 'out' / 'report.html'}")
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("<svg") < page.index("<table") and "Tilt error: swing" in page and ">VQF<" in page
    assert json.loads((tmp_path / "out" / "comparison.json").read_text())["inputs"][0]["grade"] == "recorded"


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert front.main(["compare", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1
    return captured.err


def test_what_cannot_be_compared_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "swing.npz has no reference" in refusal([swing(tmp_path, ref_quat=None)], capsys)
    still = swing(tmp_path, movement=np.zeros(1500, bool))
    assert "nothing to score" in refusal([still], capsys)
    assert "no grade 'gold'; give all, or one of: recorded: " in refusal([swing(tmp_path), "--grade", "gold"], capsys)
    wrong = refusal([swing(tmp_path), "--algorithm", "vqf"], capsys)
    assert "no algorithm 'vqf' to compare; there are VQF, BasicVQF, Madgwick, Mahony, " in wrong
    assert "no-such-file.npz" in refusal(["no-such-file.npz"], capsys)


@pytest.mark.parametrize("module", ["vqf", "ahrs.filters"])
def test_a_missing_package_says_what_to_install(
    module: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    package = {"vqf": "vqf", "ahrs.filters": "AHRS"}[module]
    assert f"{package} is not installed; install it " in refusal([swing(tmp_path)], capsys)


def test_motions_need_no_recording_and_name_their_rows(capsys: pytest.CaptureFixture[str]) -> None:
    chosen = ["--only", "dash-5", "--only", "arm-170", "--algorithm", "VQF", "--algorithm", "attitude"]
    assert front.main(["compare", "--motions", "--seeds", "2", *chosen, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [one["input"] for one in report["inputs"]] == ["arm-170", "dash-5"]
    assert [(row["seed"], row["algorithm"]) for row in report["inputs"][0]["rows"]] == [
        (1000, "VQF"), (1000, "attitude"), (1001, "VQF"), (1001, "attitude"),
    ]  # fmt: skip


def test_motions_that_cannot_be_chosen_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "name recordings, or give --motions" in refusal([], capsys)
    assert "give --motions" in refusal([swing(tmp_path), "--seeds", "3"], capsys)
    assert "no motion 'arm'; there are arm-170, " in refusal(["--motions", "--only", "arm"], capsys)
    assert "--seeds is 1 or more, not 0" in refusal(["--motions", "--seeds", "0"], capsys)

"""`plumb tune`: what it prints and writes, and one sentence for what it cannot use."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.tuning.quantise import quantise


@pytest.fixture(autouse=True)
def packages() -> None:
    pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")


def rest_file(folder: Path, name: str = "rest.npz", samples: int = 3000, **changed: object) -> str:
    """A made-up rest: white noise of 0.05 deg/s/sqrt(Hz) and 0.3 mg/sqrt(Hz), 100 Hz."""
    rng = np.random.default_rng(2)
    columns: dict[str, object] = {
        "gyr": np.radians(0.5) * rng.standard_normal((samples, 3)),
        "acc": 9.80665 * (3e-3 * rng.standard_normal((samples, 3)) + [0.0, 0.0, 1.0]),
        "rate_hz": np.float64(100.0),
    }
    path = folder / name
    np.savez(path, **{**columns, **changed})  # type: ignore[arg-type]
    return str(path)


def test_noise_prints_figures_settings_and_the_line_that_sets_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["tune", "noise", rest_file(tmp_path), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("rest.npz: at rest from 0.0 to 30.0 s of 30.0 s, 3000 samples every 10 ms.")
    assert "plumb params set kalman.q_angle_deg2_per_s=0.00" in printed
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Gyro: Allan deviation" in page and page.count('<section class="still">') == 2
    assert page.count("<circle") > 50 and "averaging time (s)" in page
    told = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert [one["name"] for one in told["signals"]] == ["gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z"]


def test_noise_json_can_be_used_as_a_tuning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from plumb.inputs.identification import chosen_settings
    from plumb.systems.quad.scenarios import TUNINGS

    options = ["--system", "quad", "--tuning", "constant", "--period-us", "10000", "--json"]
    assert front.main(["tune", "noise", rest_file(tmp_path), *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["system"], told["tuning"], told["period_us"]) == ("quad", "constant", 10_000)
    assert told["settings"]["kalman.q_angle_deg2_per_s"] == pytest.approx(0.0025, rel=0.2)
    assert told["refusal"] == ""
    quantise(chosen_settings.changed(TUNINGS["constant"], told["settings"]))


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert front.main(["tune", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1, captured.err
    return captured.err


def test_what_noise_cannot_use_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = rest_file(tmp_path)
    assert "no-such-file.npz" in refusal(["noise", str(tmp_path / "no-such-file.npz")], capsys)
    assert "has no parameters" not in refusal(["noise", str(tmp_path)], capsys)  # a folder without a recording
    assert "there is no system 'toaster'" in refusal(["noise", good, "--system", "toaster"], capsys)
    assert "no tuning 'gold'" in refusal(["noise", good, "--system", "quad", "--tuning", "gold"], capsys)
    assert "is not 10 s of the recording" in refusal(["noise", good, "--from", "25"], capsys)
    assert "is not 10 s of the recording" in refusal(["noise", good, "--from", "20", "--to", "10"], capsys)
    assert "500 to 100000 us" in refusal(["noise", good, "--period-us", "1"], capsys)
    assert "too short for it" in refusal(["noise", good, "--highest-hz", "0"], capsys)
    still = rest_file(tmp_path, "still.npz", gyr=np.zeros((3000, 3)))
    assert "gyr_x: the signal does not change at all" in refusal(["noise", still], capsys)
    moving = np.radians(90.0) * np.sin(np.arange(3000) / 10.0)[:, None] * np.ones(3)
    assert "no rest of 10 s" in refusal(["noise", rest_file(tmp_path, "moving.npz", gyr=moving)], capsys)


def test_damaged_folder_of_a_recording_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "board.json").write_text('{"parameters": [1, 2]}')
    (tmp_path / "steps.csv").write_text("step,digest\n")
    assert "no parameters that this version knows" in refusal(["noise", str(tmp_path)], capsys)


def test_without_scipy_the_extra_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "needs scipy" in (said := refusal(["noise", rest_file(tmp_path)], capsys)) and "tune" in said

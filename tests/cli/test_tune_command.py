"""`plumb tune`: what it prints and writes, and one sentence for what it cannot use."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.analyses.identification import chosen_settings, rest
from plumb.contract.parameters import groups_of, quantise
from plumb.systems.quad.scenarios import TUNINGS, scenario
from support.recordings import log_of_counts, recorded_run


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
    assert 0 < page.index("<svg") < page.index("<table"), "pictures stand before tables"
    assert "Gyro: Allan deviation" in page and page.count('<section class="still">') == 2
    assert page.count("<circle") > 50 and "averaging time (s)" in page
    report = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert [one["name"] for one in report["signals"]] == ["gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z"]


def test_noise_json_can_be_used_as_a_tuning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:

    options = ["--system", "quad", "--tuning", "constant", "--period-us", "10000", "--json"]
    assert front.main(["tune", "noise", rest_file(tmp_path), *options]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["system"], report["tuning"], report["period_us"]) == ("quad", "constant", 10_000)
    # 0.05^2 of the made-up rest; Allan deviations at short times are good to some per cent, their squares to twice
    # that.
    assert report["settings"]["kalman.q_angle_deg2_per_s"] == pytest.approx(0.0025, rel=0.2)
    assert report["refusal"] == ""
    quantise(chosen_settings.changed(TUNINGS["constant"], report["settings"]))


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
    assert "is not 10 s of the recording" in refusal(["noise", good, "--begin", "25"], capsys)
    assert "is not 10 s of the recording" in refusal(["noise", good, "--begin", "20", "--end", "10"], capsys)
    assert "500 to 100000 us" in refusal(["noise", good, "--period-us", "1"], capsys)
    assert "is not 10 s of the recording" in refusal(["noise", good, "--end", "-5"], capsys)
    assert "--begin nan: give a finite number" in refusal(["noise", good, "--begin", "nan"], capsys)
    assert "too short for it" in refusal(["noise", good, "--highest-hz", "0"], capsys)
    still = rest_file(tmp_path, "still.npz", gyr=np.zeros((3000, 3)))
    assert "gyr_x: the signal does not change at all" in refusal(["noise", still], capsys)
    moving = np.radians(90.0) * np.sin(np.arange(3000) / 10.0)[:, None] * np.ones(3)
    assert "no rest of 10 s" in refusal(["noise", rest_file(tmp_path, "moving.npz", gyr=moving)], capsys)


def test_a_board_s_log_is_taken_and_a_damaged_one_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recorded_run(tmp_path / "run.plog", seconds=12.0)
    whole = rest.load(path)
    assert whole.system == "quad" and [one.name for one in whole.channels] == ["gyro", "accel_y", "accel_z"]
    # The cosine of the tilts of a board that is nearly level, and the zero of its channel: ten counts.
    assert np.mean(whole.channels[2].values) == pytest.approx(1.0, abs=0.01)
    (tmp_path / "bad.plog").write_bytes(path.read_bytes()[:100])
    assert "holds no whole block" in refusal(["noise", str(tmp_path / "bad.plog")], capsys)


def test_without_scipy_the_extra_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "needs scipy" in (said := refusal(["noise", rest_file(tmp_path)], capsys)) and "tune" in said


def swing_file(folder: Path) -> str:
    """A swing about x with white noise of R = 0.5 deg^2 and a gyro of Q = 0.02 deg^2/s, 100 Hz."""
    rng = np.random.default_rng(1)
    rate = 30.0 * np.sin(0.02 * np.arange(2000))
    tilt = np.concatenate([[0.0], np.cumsum(rate[:-1] * 0.01)])
    z = np.radians(tilt + np.sqrt(0.5) * rng.standard_normal(2000))
    zero = np.zeros(2000)
    gyro = np.radians(rate + np.sqrt(0.02 / 0.01) * rng.standard_normal(2000))
    acc = 9.80665 * np.column_stack([zero, np.sin(z), np.cos(z)])
    path = folder / "swing.npz"
    np.savez(path, gyr=np.column_stack([gyro, zero, zero]), acc=acc, rate_hz=np.float64(100.0))
    return str(path)


def test_filter_prints_settings_and_consistency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["tune", "filter", swing_file(tmp_path), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("swing.npz about x: 2000 steps of 10 ms; quad, tuning recording.")
    assert "Consistency of the filter" in printed and "plumb params set kalman.q_angle_deg2_per_s=" in printed
    report = json.loads((tmp_path / "out" / "tune.json").read_text())
    # A variance of 2000 samples is known to sqrt(2 / 2000) = 3 %; three times that. The mean of what was fitted is 1
    # by the fit.
    assert report["settings"]["trust.r_deg2"] == pytest.approx(0.5, rel=0.1)
    assert report["after"]["mean_nis"] == pytest.approx(1.0, abs=0.02) and report["refusal"] == ""
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Whiteness" in page and "Innovations after" in page


def test_settings_of_no_use_are_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:

    monkeypatch.setattr(chosen_settings, "refusal", lambda tuning: "too large")
    assert front.main(["tune", "filter", swing_file(tmp_path)]) == 1
    captured = capsys.readouterr()
    assert "the board cannot hold the settings: too large" in captured.err and "params set" not in captured.out


def test_what_filter_cannot_use_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = swing_file(tmp_path)
    assert "steps are too few" in refusal(["filter", good, "--seconds", "3"], capsys)
    assert "greater than 0" in refusal(["filter", good, "--seconds", "0"], capsys)
    for other in systems.SYSTEMS:
        if "pid" not in groups_of(other):  # its filter is not of one axis
            assert other in refusal(["filter", good, "--system", other], capsys)
    assert "500 to 100000 us" in refusal(["filter", good, "--period-us", "10"], capsys)


def board_recording(path: Path, steps: int = 1100) -> Path:
    """A log of a board: quad, shipped tuning, `quiet`; every 50th step lost its counts."""
    counts = scenario("quiet", 3, seconds=steps * 0.02).counts()
    return log_of_counts(path, quantise(TUNINGS["adaptive"]), counts, lost=range(7, steps, 50))


def test_a_board_recording_is_tuned_with_its_own_parameters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = str(board_recording(tmp_path / "run.plog"))
    assert front.main(["tune", "filter", run, "--json"]) in (0, 1)
    report = json.loads(capsys.readouterr().out)
    assert (report["system"], report["tuning"], report["period_us"]) == ("quad", "as recorded", 20_000)
    assert report["settings_before"]["trust.r_deg2"] == pytest.approx(0.25, rel=1e-3)
    assert "was quad, not balancer" in refusal(["filter", run, "--system", "balancer"], capsys)
    assert "counts have its period" in refusal(["filter", run, "--period-us", "5000"], capsys)
    assert front.main(["tune", "noise", run, "--begin", "0", "--end", "22", "--json"]) == 1  # it moves: no R follows
    report = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in report["signals"]] == ["gyro", "accel_y", "accel_z"]
    # In g: 1 - cos of the tilts of `quiet`, and noise of 8 mg.
    assert report["signals"][2]["rms"] < 0.1 and report["period_us"] == 20_000
    assert "more than 0" in report["refusal"] and report["apply"] == []


def test_pid_of_the_twin_has_the_margins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--board", "native", "--tuning", "adaptive", "--periods", "4", "--out", str(tmp_path / "out")]
    assert front.main(["tune", "pid", *options]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("quad on native, steps of 20 ms; setpoint swung by 8 deg, 4 periods.")
    assert "plumb params set pid.kp_per_deg=" in printed and "after, measured" in printed
    assert re.search(r"^ +damping, 1/s +0 +0 to ", printed, re.MULTILINE), "at its bound, and no rounding of it"
    report = json.loads((tmp_path / "out" / "tune.json").read_text())
    # 35 deg are asked for: before, the twin has clearly less; after, as much as the rounded gains leave. Measured at
    # few frequencies, with the noise of four periods: to 5 deg.
    assert report["met"] and report["margins_before"]["phase_deg"] < 26.0
    assert report["margins"]["phase_deg"] > 34.6 and report["margins_measured"]["phase_deg"] > 30.0
    quantise(chosen_settings.changed(TUNINGS["adaptive"], report["settings"]))
    assert "Loop gain: phase" in (tmp_path / "out" / "report.html").read_text()


def test_a_machine_does_not_move_without_consent(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("the board was opened")

    monkeypatch.setattr("plumb.boards.open_board", opened)
    said = refusal(["pid", "--board", "serial:/dev/ttyUSB0"], capsys)
    assert "swings the machine by 8 deg for 39 s" in said and "--arm-and-move" in said
    said = refusal(["pid", "--board", "can:socketcan:can0", "--arm-and-move", "--tuning", "adaptive"], capsys)
    assert "a board is tested as it is" in said


def test_a_broken_scipy_is_reported_before_anything_moves(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("the board was opened")

    monkeypatch.setattr("plumb.boards.open_board", opened)
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    said = refusal(["pid", "--board", "serial:/dev/ttyUSB0", "--arm-and-move"], capsys)
    assert "scipy is there but does not load" in said and "tune" in said


def test_what_pid_cannot_use_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    native = ["pid", "--board", "native"]
    assert "give 0.1 to 20" in refusal([*native, "--amplitude", "90"], capsys)
    assert "give 3 to 100" in refusal([*native, "--periods", "1"], capsys)
    assert "--phase-deg 0: give 5 to 80" in refusal([*native, "--phase-deg", "0"], capsys)
    assert "balancer holds no tilt" in refusal([*native, "--system", "balancer"], capsys)
    assert "no tuning 'gold'" in refusal([*native, "--tuning", "gold"], capsys)
    assert "500 (2 kHz) to 100000" in refusal([*native, "--period-us", "1"], capsys)
    assert "--live is for --board virtual" in refusal([*native, "--live"], capsys)
    assert "closes no loop" in refusal(["pid", "--board", "qemu", "--arm-and-move"], capsys)


def test_a_log_shorter_than_a_rest_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    counts = scenario("quiet", 3, seconds=1.0).counts()[:15]
    short = log_of_counts(tmp_path / "short.plog", quantise(TUNINGS["adaptive"]), counts)
    assert "has no rest of 10 s" in refusal(["noise", str(short)], capsys)


def test_a_folder_that_cannot_be_written_is_reported_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("the board was opened")

    monkeypatch.setattr("plumb.boards.open_board", opened)
    (tmp_path / "file").write_text("in the way")
    machine = ["pid", "--board", "serial:/dev/ttyUSB0", "--arm-and-move", "--out", str(tmp_path / "file" / "out")]
    assert "choose another folder with --out" in refusal(machine, capsys)

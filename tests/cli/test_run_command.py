"""`plumb run` and `plumb replay`: the contract's JSON, the right exit code, and a board that lies is found out."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards.contract import Answer, RawCounts, Setpoints
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.proof import gain_changes, runs
from plumb.systems.quad import scenarios as quad
from support.declared_systems import lacking

METRICS = {
    "angle_rmse_deg",
    "angle_max_deg",
    "accel_only_rmse_deg",
    "fixed_vs_reference_max_deg",
    "target_vs_fixed_mismatches",
}


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = front.main([*arguments, "--json"])
    captured = capsys.readouterr()
    assert captured.out, captured.err
    return code, json.loads(captured.out)


@pytest.mark.parametrize(("scenario", "steps"), [("motion", 1250), ("hold", 5000)])
def test_a_run_prints_what_the_contract_names(scenario: str, steps: int, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = run(capsys, "run", "quad", "--board", "native", "--scenario", scenario, "--seconds", "25")
    assert code == 0 and said["verdict"] == "pass"
    assert (said["system"], said["board"], said["seed"], said["steps"]) == ("quad", "native", 1000, steps)
    assert set(said["metrics"]) >= METRICS
    assert said["metrics"]["target_vs_fixed_mismatches"] == 0


def test_how_far_the_axis_is_from_its_setpoint_is_said_where_it_may_leave_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Gusts tilt `hold` by 0.5 to 1 deg rms from 2 s after its release on; a prescribed motion is its own setpoint."""
    arguments = ("run", "quad", "--board", "native", "--seconds", "28")
    held = run(capsys, *arguments, "--scenario", "hold")[1]["metrics"]["setpoint_rmse_deg"]
    assert 0.5 < held < 1.0
    assert "setpoint_rmse_deg" not in run(capsys, *arguments, "--open-loop")[1]["metrics"]


@pytest.mark.slow
@pytest.mark.parametrize("board", ["native", "qemu"])
@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_every_system_runs_open_and_closed(name: str, board: str, capsys: pytest.CaptureFixture[str]) -> None:
    """tests/proof/test_confirmed.py has the virtual board, over both links."""
    if board == "qemu" and shutil.which("qemu-system-arm") is None:
        pytest.skip("qemu-system-arm is missing")
    seconds = "12" if name in ("turntable", "attitude") else "4"  # 10 s at rest; some seconds to learn the biases
    loops = {"open", "closed"} if systems.load(name).OUTPUTS else {"open"}
    for loop in loops:
        extra = ("--open-loop",) if loop == "open" else ()
        code, said = run(capsys, "run", name, "--board", board, "--seconds", seconds, *extra)
        figures = said["metrics"]
        assert code == 0 and (said["system"], said["board"], said["loop"]) == (name, board, loop)
        assert set(figures) >= METRICS and figures["target_vs_fixed_mismatches"] == 0
        assert (figures["accel_only_rmse_deg"] is None) == (name == "turntable")
        # From above: a filter that turned the wrong way would be off by tens of degrees. The scenarios' own figures
        # are in tests/proof and tests/judging.
        assert figures["angle_rmse_deg"] <= figures["angle_max_deg"] < 2.0
        assert 0.0 < figures["fixed_vs_reference_max_deg"] < 1e-3


def test_the_same_seed_gives_the_same_words(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("run", "quad", "--board", "native", "--seconds", "20", "--seed")
    first, again, other = (run(capsys, *arguments, seed)[1]["metrics"] for seed in ("7", "7", "8"))
    assert first == again != other


def test_the_loop_is_open_only_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    _, said = run(capsys, "run", "quad", "--board", "native", "--scenario", "hold", "--open-loop", "--seconds", "20")
    assert said["loop"] == "open"
    _, said = run(capsys, "run", "quad", "--board", "native", "--scenario", "hold", "--seconds", "20")
    assert said["loop"] == "closed"


def test_a_run_writes_page_summary_and_steps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, said = run(capsys, "run", "quad", "--board", "native", "--seconds", "20", "--out", str(tmp_path / "out"))
    written = json.loads((tmp_path / "out/summary.json").read_text())
    assert written.pop("identity")["part"]["board"] == "native" and written == said
    assert "<svg" in (tmp_path / "out/report.html").read_text()
    rows = (tmp_path / "out/steps.csv").read_text().splitlines()
    assert len(rows) == 1 + said["steps"]
    assert rows[0].startswith("time_s,true_tilt_deg,true_bias_dps,setpoint_deg,rate_dps,accel_y_g,")
    names = rows[0].split(",")
    last = dict(zip(names, rows[-1].split(","), strict=True))
    assert float(last["tilt_deg"]) == pytest.approx(int(last["tilt_turn_q32"]) * 360.0 / 2.0**32)
    assert names.index("pulse_1_us") < names.index("raw_0") < names.index("digest_crc32") == len(names) - 1
    assert not list((tmp_path / "out").glob("*.part"))


def test_the_steps_of_an_attitude_have_its_angles_in_degrees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "run", "attitude", "--board", "native", "--seconds", "5", "--out", str(tmp_path))
    head, *_, last = (tmp_path / "steps.csv").read_text().splitlines()
    row = {name: float(value) for name, value in zip(head.split(","), last.split(","), strict=True)}
    up = [row[f"up_q30_{axis}"] for axis in range(3)]
    assert row["roll_deg"] == pytest.approx(math.degrees(math.atan2(up[1], up[2])), abs=1e-4)
    assert row["pitch_deg"] == pytest.approx(math.degrees(math.asin(-up[0] / 2.0**30)), abs=1e-4)


class LyingBoard(NativeBoard):
    """Native, but one bit of one word of one step is wrong."""

    name = "liar"

    def __init__(self, step: int, signal: str) -> None:
        self.step, self.signal = step, signal

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        answer = super().run_injected(params, raw, setpoint)
        assert answer.words is not None
        record = answer.words.record.copy()
        if self.step < len(record):
            record[self.signal][self.step] ^= 1
        words = type(answer.words)(record)
        return replace(answer, words=words, digests=words.digests())

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = self.run_injected(params, raw[: step + 1], setpoint[: step + 1]).words
        assert words is not None
        return {name: int(values[step]) for name, values in words.items()}


@pytest.mark.parametrize("signal", ["innovation_turn_q32", "p11", "pulse_halfus_1"])
def test_one_wrong_bit_is_a_failed_verdict_with_step_and_signal(signal: str) -> None:
    inputs = runs.prescribed(quad.scenario("motion", 3, seconds=4.0))
    params = quantise(quad.TUNINGS["adaptive"])
    judged = runs.open_loop(LyingBoard(77, signal), inputs, params)
    assert judged.verdict == "fail" and judged.mismatches == 1
    assert judged.divergence is not None
    assert (judged.divergence.step, judged.divergence.signal) == (77, signal)


def test_a_lost_digest_is_unverified_not_passed() -> None:
    inputs = runs.prescribed(quad.scenario("motion", 3, seconds=4.0))
    params = quantise(quad.TUNINGS["adaptive"])
    answer = NativeBoard().run_injected(params, inputs.raw, inputs.setpoint)
    judged = runs.judge(NativeBoard(), inputs, params, replace(answer, unverified_from=120))
    assert judged.verdict == "unverified"
    assert judged.summary()["unverified_from_step"] == 120


def recording_file(folder: Path, **changed: Any) -> Path:
    """A made-up recording: turning about x, with its reference."""
    time_s = np.arange(2000) / 200.0
    tilt = np.radians(20.0) * np.sin(2.0 * np.pi * 0.3 * time_s)
    rate = np.gradient(tilt, time_s)
    zero = np.zeros_like(tilt)
    columns: dict[str, Any] = {
        "gyr": np.column_stack([rate, zero, zero]).astype(np.float32),
        "acc": 9.80665 * np.column_stack([zero, np.sin(tilt), np.cos(tilt)]).astype(np.float32),
        "ref_quat": np.column_stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero]).astype(np.float32),
        "movement": np.ones(2000, bool),
        "rate_hz": np.float64(200.0),
    }
    path = folder / "recording.npz"
    np.savez(path, **{**columns, **changed})
    return path


def test_a_replay_reports_the_error_against_the_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = run(capsys, "replay", str(recording_file(tmp_path)), "--axis", "x", "--board", "native")
    assert code == 0 and said["verdict"] == "pass"
    # Exact samples: 1.5 % of the swing by 20 deg. The first of the 2000 steps are not scored.
    assert said["metrics"]["angle_rmse_deg"] < 0.3
    assert said["scored_steps"] > 1900


def test_a_replay_about_z_warns_that_gravity_does_not_turn_about_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["replay", str(recording_file(tmp_path)), "--system", "quad", "--board", "native", "--seconds", "2"]
    for axis, many in (("x", 0), ("y", 0), ("z", 1)):
        assert front.main([*command, "--axis", axis, "--json"]) == 0
        printed = capsys.readouterr()
        warnings = json.loads(printed.out)["warnings"]
        assert len(warnings) == many and all("gravity does not turn about" in sentence for sentence in warnings)
        assert printed.err.splitlines() == [f"plumb: warning: {sentence}" for sentence in warnings]


def test_a_recording_at_rest_has_nothing_to_score(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = recording_file(tmp_path, movement=np.zeros(2000, bool))
    code, said = run(capsys, "replay", str(file), "--board", "native")
    assert code == 0 and said["metrics"]["angle_rmse_deg"] is None and said["scored_steps"] == 0
    assert front.main(["replay", str(file), "--board", "native"]) == 0
    assert "nothing to score" in capsys.readouterr().out


def test_a_recording_with_nan_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = np.zeros((2000, 3), np.float32)
    broken[500, 1] = np.nan
    assert front.main(["replay", str(recording_file(tmp_path, gyr=broken)), "--board", "native"]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and "gyr" in captured.err and len(captured.err.splitlines()) == 1


@pytest.mark.parametrize(("seconds", "code"), [("nan", 2), ("0", 2), ("-1", 2), ("inf", 2)])
def test_any_length_of_a_replay_is_taken_or_refused(
    seconds: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(recording_file(tmp_path))
    assert front.main(["replay", file, "--board", "native", "--seconds", seconds]) == code
    assert len(capsys.readouterr().err.splitlines()) == (1 if code else 0)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_real_recording_agrees_in_every_bit(axis: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = os.environ.get("PLUMB_DATA")
    if not folder:
        pytest.skip("PLUMB_DATA does not name a folder with recordings")
    file = Path(folder) / "broad_02_undisturbed_slow_rotation_B.npz"
    code, said = run(capsys, "replay", str(file), "--axis", axis, "--board", "native", "--seconds", "60")
    assert code == 0 and said["metrics"]["target_vs_fixed_mismatches"] == 0
    assert said["metrics"]["angle_rmse_deg"] is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "loop", "seconds"), [("quad", (), "3"), ("balancer", ("--open-loop",), "4"), ("wheels", (), "4.5")]
)
def test_a_live_run_is_armed_on_its_own_sensors_and_verified(
    system: str, loop: tuple[str, ...], seconds: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("unicorn")
    code, said = run(capsys, "run", system, "--board", "virtual", "--live", "--seconds", seconds, *loop)
    assert code == 0 and said["live"] is True and said["metrics"]["target_vs_fixed_mismatches"] == 0
    assert said["loop"] == ("open" if loop else "closed")


@pytest.mark.parametrize(("system", "board"), [("quad", "native"), *((name, "virtual") for name in lacking("pins"))])
def test_a_live_run_without_sensors_is_refused(system: str, board: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["run", system, "--board", board, "--live"]) == 2
    said = capsys.readouterr().err
    assert "sensors" in said and len(said.splitlines()) == 1


def test_a_flight_without_live_is_flown_by_the_same_pilot_and_held_to_a_limit(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert front.main(["run", "quadrotor", "--board", "native", "--live"]) == 2
    refused = capsys.readouterr().err
    assert "--live is for --board virtual" in refused and "leave --live out" in refused
    code, said = run(capsys, "run", "quadrotor", "--board", "native", "--seconds", "8")
    flown = [row for row in said["accuracy_limits"] if row["metric"] == "flown_rmse_deg"]
    assert code == 0 and len(flown) == 1 and 0 < flown[0]["reached"] < flown[0]["value"]


@pytest.mark.slow
def test_gains_change_on_the_way_of_a_live_run_and_the_model_follows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("unicorn")
    live = ("run", "quad", "--board", "virtual", "--live", "--seconds", "2", "--tuning", "adaptive")
    changes = ("--change", "1.5:pid.ki=0.2", "--change", "1:pid.kp=0.08")
    assert front.main([*live, *changes, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    (first, second) = map(int, re.findall(r"gains changed at step (\d+) and (\d+)", said)[0])
    assert 50 <= first < second <= 80 and "bit-exact: every one of the 100 steps" in said
    assert json.loads((tmp_path / "summary.json").read_text())["changes"] == ["1.5:pid.ki=0.2", "1:pid.kp=0.08"]


@pytest.mark.parametrize("change", ["3", "inf:pid.kp=1", "-1:pid.kp=1", "x:pid.kp=1", "1:=5", "1:pid.kp", ""])
def test_a_text_that_is_no_change_is_one_sentence(change: str) -> None:
    with pytest.raises(UsageError, match="is no change: write SECONDS:NAME=VALUE"):
        gain_changes.parse(change)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("1:pid.nope=1", "there is no parameter 'pid.nope'"),
        ("9:pid.kp=0.05", "comes after the run of 50 steps"),
        ("0.5:pid.kp=0.2", "is more than twice 0.045, its value at arming: an armed board takes 0.09 at most"),
    ],
)
def test_a_change_that_cannot_be_is_one_sentence(
    change: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("unicorn")
    live = ["run", "quad", "--board", "virtual", "--live", "--seconds", "1", "--tuning", "adaptive"]
    assert front.main([*live, f"--change={change}"]) == 2
    said = capsys.readouterr().err
    assert sentence in said and len(said.splitlines()) == 1
    assert front.main(["run", "quad", "--board", "native", "--seconds", "1", f"--change={change}"]) == 2
    assert "--change is for --live" in capsys.readouterr().err

"""plumb.run, plumb.load and plumb.golden.check give what the commands print."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import plumb
from plumb import __main__ as front
from plumb import systems
from plumb.proof import golden


def printed(arguments: Sequence[str], capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    assert front.main([*arguments, "--json"]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_a_run_has_the_figures_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "quad", "--board", "native", "--scenario", "hold", "--seconds", "14", "--tuning", "paper"]
    arguments += ["--start", "fast", "--seed", "7", "--fault", "noisy:gyro@3-4", "--condition", "bandwidth_hz=50"]
    result = plumb.run(
        "quad",
        board="native",
        scenario="hold",
        seconds=14,
        tuning="paper",
        start="fast",
        seed=7,
        faults=["noisy:gyro@3-4"],
        conditions={"bandwidth_hz": 50},
    )
    assert json.loads(json.dumps(result.summary())) == {
        **printed(arguments, capsys),
        "conditions": {"bandwidth_hz": 50.0},
    }
    assert result.bit_exact is True and result.verdict == "pass" and result.first_divergence is None
    assert result["tilt_deg"] == pytest.approx(result.words["tilt_turn_q32"] * 360.0 / 2**32)
    assert len(result.time_s) == result.steps == 700


@pytest.mark.parametrize(
    ("tuning", "seed", "accuracy"), [("adaptive", 1001, "pass"), ("adaptive", 1000, "fail"), ("paper", 1001, "pass")]
)
def test_accuracy_is_stated_with_bits(tuning: str, seed: int, accuracy: str) -> None:
    """Within the declared limit, outside it (which the mean of many seeds is to keep), and within a measured one."""
    result = plumb.run("quad", scenario="motion", tuning=tuning, seed=seed, open_loop=True)
    assert (result.bit_exact, result.verdict, result.accuracy) == (True, "pass", accuracy)
    assert result.accuracy == result.summary()["accuracy"]


def test_a_run_takes_a_tuning_object() -> None:
    named = plumb.run("balancer", tuning="arctan", seconds=5, open_loop=True)
    given = plumb.run("balancer", tuning=plumb.Estimator("balancer", "arctan").tuning, seconds=5, open_loop=True)
    assert (named.digests == given.digests).all()


def test_a_report_is_written(tmp_path: Path) -> None:
    plumb.run("quad", seconds=12).write_report(tmp_path / "out")
    assert (tmp_path / "out" / "report.html").is_file() and (tmp_path / "out" / "summary.json").is_file()


def test_wrong_names_are_refused() -> None:
    with pytest.raises(plumb.UsageError, match="there is no system 'quat'"):
        plumb.run("quat")
    with pytest.raises(plumb.UsageError, match="no scenario 'hodl'"):
        plumb.run("quad", scenario="hodl")
    with pytest.raises(plumb.UsageError, match="no tuning 'papre'"):
        plumb.run("quad", tuning="papre")
    with pytest.raises(plumb.UsageError, match="no condition 'wind'"):
        plumb.run("quad", conditions={"wind": 3})
    with pytest.raises(plumb.UsageError, match="a list"):
        plumb.run("quad", faults="push:0.1@3")
    with pytest.raises(plumb.UsageError, match="tuning is of balancer"):
        plumb.run("quad", tuning=plumb.Estimator("balancer").tuning)


def rocking(path: Path) -> Path:
    time_s = np.arange(0.0, 4.0, 0.01)
    angle = np.radians(30.0) * np.sin(2.0 * np.pi * 0.4 * time_s)
    gyr = np.zeros((len(time_s), 3))
    gyr[:, 0] = np.gradient(angle, 0.01)
    acc = 9.80665 * np.stack([0.0 * angle, np.sin(angle), np.cos(angle)], axis=1)
    quat = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0.0 * angle, 0.0 * angle], axis=1)
    np.savez(path, time_s=time_s, gyr=gyr, acc=acc, ref_quat=quat)
    return path


@pytest.mark.parametrize("system", systems.with_part("replay"))
def test_a_replay_has_the_figures_of_the_command(
    system: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = rocking(tmp_path / "rocking.npz")
    recording = plumb.load(path)
    assert recording.gyr_radps.shape == recording.acc_mps2.shape == (400, 3)
    assert recording.truth is not None and recording.truth.shape == (400, 4)
    result = recording.replay(system, "native", seconds=3)
    command = ["replay", str(path), "--system", system, "--board", "native", "--seconds", "3"]
    said = printed(command, capsys)
    audited = said.pop("check")
    assert isinstance(audited, dict) and audited["findings"]
    assert json.loads(json.dumps(result.summary())) == said
    assert result.bit_exact


def test_a_replay_that_cannot_be_is_refused(tmp_path: Path) -> None:
    recording = plumb.load(rocking(tmp_path / "rocking.npz"))
    with pytest.raises(plumb.UsageError, match="no recording"):
        recording.replay("turntable")
    with pytest.raises(plumb.UsageError, match=r"0\.0005"):
        recording.replay(period_s=1.0)
    with pytest.raises(plumb.UsageError, match="No such file"):
        plumb.load(tmp_path / "rocking.mat")
    (tmp_path / "rocking.mat").touch()
    with pytest.raises(plumb.UsageError, match=r"rocking\.mat is empty"):
        plumb.load(tmp_path / "rocking.mat")


def test_golden_vectors_have_a_result_each() -> None:
    checked = plumb.golden.check(["native", "fixed"], ["quad"], names=["quad_motion_*"])
    assert checked.bit_exact and not checked.failed()
    assert {one.board for one in checked.vectors} == {"native", "fixed"}
    assert plumb.golden.VectorResult is golden.VectorResult
    assert all(one.bit_exact and one.verdict == "pass" and one.to_json()["vector"] for one in checked.vectors)
    assert len(checked.vectors) == 2 * len({one.vector for one in checked.vectors}) > 2
    with pytest.raises(plumb.UsageError, match="a list"):
        plumb.golden.check("native")
    with pytest.raises(plumb.UsageError, match="is not a board"):
        plumb.golden.check(["nativ"])

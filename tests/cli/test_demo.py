"""`plumb demo`: the main job, on the image that was built, from the sensors' volts to the report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.flash.image import find_image
from plumb.link.holding import Holding
from plumb.proof import golden
from plumb.systems.quad import scenarios as quad

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")
try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

from plumb.boards.virtual import VirtualBoard
from plumb.proof import live_run
from plumb.proof.live_run import run_live
from plumb.proof.runs import Run
from plumb.systems.contracts import Conversion


def one_of_each_system(folder: Path, systems: Sequence[str] | None = None) -> list[golden.Case]:
    """The shortest vector of each system that every board runs. All of them on all boards: test_golden.py."""
    found: dict[str, golden.Case] = {}
    for case in sorted(all_cases(folder, systems), key=lambda case: case.entry.steps):
        if case.entry.on_link:
            found.setdefault(case.entry.system, case)
    return list(found.values())


all_cases = golden.cases


@pytest.mark.slow
def test_the_demo_holds_the_axis_level_and_agrees_in_every_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`flown` is the run of the report, as the board flew it."""
    flown: list[Run] = []

    def kept(board: Any, *arguments: Any, **named: Any) -> Run:  # Any: the arguments of run_live, passed on
        flown.append(run_live(board, *arguments, **named))
        assert board.machine.warnings == []
        return flown[-1]

    monkeypatch.setattr(live_run, "run_live", kept)
    monkeypatch.setattr(golden, "cases", one_of_each_system)
    assert front.main(["demo", "--seconds", "17", "--seed", "1001", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["verdict"] == "pass" and summary["metrics"]["target_vs_fixed_mismatches"] == 0
    errors = summary["tilt_error_deg"]
    assert errors["hold, the board"] == errors["hold, fixed"]
    assert errors["hold, the board"]["rms"] < errors["the paper's constants, fixed"]["rms"]
    assert errors["the paper's constants, fixed"]["rms"] < errors["accelerometer only"]["rms"]
    assert {"native", "virtual", "virtual, CAN"} <= summary["golden"].keys()
    assert all(row["mismatches"] == 0 and row["vectors"] >= 4 for row in summary["golden"].values())
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") == 6
    assert "accelerometer only" in said and said.rstrip().splitlines()[-3] == "pass"

    (run,) = flown
    tilt_deg, time_s = run.inputs.truth["tilt_deg"], run.inputs.time_s
    # One seed: 1.3 deg as in tests/judging/test_quad_figures.py, which gives the reason; 4 deg is three times as much.
    released_s = quad.HOLD_RELEASE_S + quad.hold_later_s(1001)
    late = tilt_deg[time_s > released_s + 2.4]
    assert len(late) > 200
    assert 0.0 < np.sqrt(np.mean(late**2)) < 1.3 and np.max(np.abs(late)) < 4.0
    pulled = tilt_deg[(time_s > released_s - 0.2) & (time_s < released_s)]
    assert pulled.max() > 19.0  # the scenario pulls the axis to 20 deg; 1 deg is the rms that the loop may have


@pytest.mark.slow
def test_a_live_open_loop_takes_the_counts_of_the_scenario_and_knows_its_truth_to_the_last_step() -> None:
    scenario = quad.scenario("motion", 1002, seconds=4.0)
    with VirtualBoard() as board:
        flown = live_run.run_live(board, scenario, quantise(quad.TUNINGS["adaptive"]), open_loop=True)
    assert np.array_equal(flown.inputs.raw, scenario.counts())
    assert np.array_equal(flown.inputs.truth["bias_dps"], scenario.bias_dps)


@pytest.mark.slow
def test_a_live_run_sends_the_setpoints_as_they_change() -> None:
    """A step or two late, as over any link; which step was the first to use one the board says, so all is verified."""
    scenario = quad.scenario("motion", 1005, seconds=6.0)
    with VirtualBoard() as board:
        flown = live_run.run_live(board, scenario, quantise(quad.HOLD))
    asked, used = scenario.setpoint().astype(np.int64), flown.inputs.setpoint.astype(np.int64)
    # The setpoint of `motion` changes in most of 300 steps.
    assert flown.verdict == "pass" and len(set(used.tolist())) > 50
    late = [int(np.abs(used[steps:] - asked[: len(asked) - steps]).max()) for steps in range(4)]
    assert min(late) < 2**32 / 360, "within a degree of what was asked a few steps before"


def test_conversions_before_the_run_are_not_its_steps() -> None:
    """Also where the counts alone would not show it: the sensor stands still."""
    taken = [Conversion(at * 0.01, 2048, {"tilt_deg": float(at)}) for at in range(60)]
    streamed = np.full((50, 6), 2048, np.int16)
    streamed[10] = 0  # lost on the link
    found = live_run.conversions_of(taken, 0.025, streamed)
    assert [conversion.truth["tilt_deg"] for conversion in found] == list(range(3, 53))
    with pytest.raises(LinkError, match="50 steps of 40"):
        live_run.conversions_of(taken, 0.195, streamed)
    streamed[20, 0] = 2049
    with pytest.raises(LinkError, match=r"step 20 is not the conversion of its turn: .* 2049, its sensor gave 2048"):
        live_run.conversions_of(taken, 0.025, streamed)


def test_a_board_that_disarms_itself_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is streamed after that is a drone that falls: no figure may come of it."""
    monkeypatch.setattr(Holding, "follow", lambda holding, frames, run_tag: [])
    scenario = quad.scenario("hold", 1004, seconds=4.0)
    with VirtualBoard() as board, pytest.raises(LinkError, match="disarmed itself before step"):
        live_run.run_live(board, scenario, quantise(quad.HOLD))

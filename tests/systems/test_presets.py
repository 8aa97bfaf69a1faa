"""Every system offers its presets in the same place; what is asked to go wrong does, or is refused in a sentence."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.contract import disturbance
from plumb.contract.parameters import dequantise, quantise
from plumb.contract.step import FIXED, REFERENCE
from plumb.errors import UsageError
from plumb.judging.quad import bandwidth
from plumb.proof.figures import FIGURES
from plumb.proof.runs import PLOTS
from plumb.spec import declarations, parameters
from plumb.spec.records import RECORDS
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.plant import QuadPlant


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert front.main([*arguments, "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def test_systems_records_and_numbers_belong_together() -> None:
    assert set(systems.SYSTEMS) == set(RECORDS)
    highest = next(row.max for row in parameters.table() if row.name == "system")
    assert {declarations.system(name).number for name in RECORDS} <= set(range(highest + 1))


@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_a_system_offers_its_presets(name: str) -> None:
    system = systems.load(name)
    assert system.SCENARIOS.keys() == system.SECONDS.keys() and system.TUNINGS.keys() == system.TUNING_NOTES.keys()
    assert system.STARTS.keys() == system.START_NOTES.keys()
    assert system.DEFAULT_SCENARIO in system.SCENARIOS and system.DEFAULT_TUNING in system.TUNINGS
    assert set(system.OUTPUTS) <= set(RECORDS[name].names or ())
    for part in (FIXED, REFERENCE, PLOTS, FIGURES):
        systems.load(name, part)
    for tuning in system.TUNINGS.values():
        assert quantise(tuning).system == name and dequantise(quantise(tuning)).system == name
    run = system.scenario(system.DEFAULT_SCENARIO, 3, seconds=4.0)
    steps = round(4.0e6 / run.period_us)
    assert (
        run.steps == steps
        and run.counts().shape == (steps, declarations.system(name).inputs)
        and run.setpoint().shape == (steps,)
    )
    assert all(values.shape[0] == steps for values in run.truth().values()) and run.scored.shape == (steps,)


@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_its_presets_are_printed_in_one_place(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["systems", "--system", name]) == 0
    text, system = capsys.readouterr().out, systems.load(name)
    for names in (system.SCENARIOS, system.TUNINGS, system.STARTS, system.CONDITIONS, system.FAULTS):
        assert all(f"  {key}" in text for key in names)
    assert f"  WHAT              {', '.join(system.FAULT_CHANNELS)}\n" in text
    for channel in system.FAULT_CHANNELS:
        assert system.faults([disturbance.parse(f"stuck:{channel}@1")])
    listed = said(capsys, "systems", "--system", name)["presets"][name]
    assert set(listed["tuning"]) == set(system.TUNINGS) and set(listed["fault"]) == set(system.FAULTS)
    assert listed["scenario"].keys() == system.SCENARIOS.keys()


def test_the_table_takes_other_seeds(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    taken: list[range] = []
    monkeypatch.setattr("plumb.proof.figures.compute", lambda names, seeds: taken.append(seeds) or iter(()))  # type: ignore[func-returns-value]
    for options in ((), ("--seeds", "3"), ("--first-seed", "5000", "--seeds", "2")):
        assert front.main(["systems", "--table", *options]) == 0
    assert taken == [range(1000, 1040), range(1000, 1003), range(5000, 5002)]
    for options in (("--first-seed", "-1"), ("--seeds", "0")):
        assert front.main(["systems", "--table", *options]) == 2


def test_the_help_of_run_says_what_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """Its examples on the native core, two seconds each: nothing that they ask for together is refused."""
    from plumb.cli import run

    examples = re.findall(r"^    plumb (run \S+ --board native.*?)(?:   .*)?$", run.__doc__ or "", re.MULTILINE)
    assert len(examples) >= 2
    for example in examples:
        assert front.main([*example.split(), "--seconds", "2", "--json"]) == 0, example


def test_the_sources_figures_are_drawn_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in ("once", "again"):
        assert front.main(["systems", "--plots", str(tmp_path / folder), "--system", "quad"]) == 0
    files = sorted((tmp_path / "once").iterdir())
    assert [str(file) for file in files] == sorted(capsys.readouterr().out.split()[: len(files)])
    for file in files:
        text = file.read_text()
        assert text.startswith("<svg") and "time (s)" in text and (tmp_path / "again" / file.name).read_text() == text


def test_every_figure_that_can_be_drawn_again_is_in_the_docs() -> None:
    folder = Path(__file__).parents[2] / "docs/figures"
    drawn = {f"{name}_{plot}.svg" for name in systems.SYSTEMS for plot in systems.load(name, FIGURES).PLOTS}
    assert drawn == {path.name for path in folder.glob("*.svg")}, "plumb systems --plots docs/figures"


@pytest.mark.parametrize(("kind", "column"), [("railed", 0), ("stuck", 1), ("silent", 2), ("noisy", 1)])
def test_a_fault_touches_its_channel_and_its_time(kind: str, column: int) -> None:
    channel = quad.FAULT_CHANNELS[column]
    asked = quad.faults([disturbance.parse(f"{kind}:{channel}@2-3")])
    clean, spoiled = (quad.scenario("motion", 5, seconds=5.0, faults=f).counts() for f in ((), asked))
    differs = np.flatnonzero((clean != spoiled).any(axis=1))
    assert 100 <= differs.min() < 105 and 140 < differs.max() < 150
    assert not (np.delete(clean, column, 1) != np.delete(spoiled, column, 1)).any()


def test_a_push_moves_the_axis() -> None:
    pushed = quad.scenario("hold", 5, seconds=6.0, faults=quad.faults([disturbance.parse("push:0.2@4-4.2")]))
    plants = [QuadPlant(run) for run in (quad.scenario("hold", 5, seconds=6.0), pushed)]
    for plant in plants:
        plant.advance_to(4.0, (1500.0, 1500.0))
    assert plants[0].tilt_deg == plants[1].tilt_deg
    for plant in plants:
        plant.advance_to(4.2, (1500.0, 1500.0))
    assert plants[1].rate_dps - plants[0].rate_dps == pytest.approx(np.degrees(0.2 / 0.015 * 0.2), rel=0.1)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--fault", "stuck"),
        ("--fault", "stuck:gyro@5-4"),
        ("--fault", "stuck:gyro@1.2.3"),
        ("--fault", "stuck:magnet@5"),
        ("--fault", "melted:gyro@5"),
        ("--fault", "push:hard@5"),
        ("--start", "slow"),
        ("--condition", "bandwidth_hz"),
        ("--condition", "colour=3"),
        ("--condition", "bandwidth_hz=nan"),
        ("--condition", "bandwidth_hz=-5"),
        ("--condition", "bandwidth_hz=0"),
    ],
)
def test_what_cannot_be_asked_for_is_refused_in_a_sentence(
    arguments: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["run", "quad", "--board", "native", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1


def test_a_run_with_a_fault_is_still_bit_exact(capsys: pytest.CaptureFixture[str]) -> None:
    run = ("run", "quad", "--board", "native", "--seconds", "20", "--open-loop")
    clean, spoiled = said(capsys, *run), said(capsys, *run, "--fault", "stuck:accel_y@12")
    assert spoiled["verdict"] == "pass" and spoiled["faults"] == ["stuck:accel_y@12"]
    assert spoiled["metrics"]["angle_rmse_deg"] > 3.0 * clean["metrics"]["angle_rmse_deg"]
    narrow = said(capsys, *run, "--condition", "bandwidth_hz=5")
    assert narrow["conditions"] == {"bandwidth_hz": 5.0} and narrow["metrics"] != clean["metrics"]


def test_the_start_up_mode_fast_settles_the_papers_filter_sooner(capsys: pytest.CaptureFixture[str]) -> None:
    run = ("run", "quad", "--board", "native", "--scenario", "converge", "--open-loop", "--tuning", "paper")
    slow, fast = (said(capsys, *run, "--start", mode)["metrics"]["bias_settled_s"] for mode in ("paper", "fast"))
    assert fast < 0.6 * slow


def test_the_bandwidth_rule_names_noise_and_filter() -> None:
    choice = bandwidth.choose(280.0)
    assert choice.corner_hz == pytest.approx(350.0) and choice.noise_mg == pytest.approx(8.2, abs=0.02)
    assert 2 * np.pi * choice.corner_hz * choice.resistor_ohm * choice.capacitor_nf * 1e-9 == pytest.approx(1.0)
    assert bandwidth.behind(20.0, 20.0).gain == pytest.approx(np.sqrt(0.5))
    assert bandwidth.behind(20.0, 20.0).phase_deg == pytest.approx(45.0)
    noises = [bandwidth.behind(hz, 1.0) for hz in quad.BANDWIDTHS_HZ]
    assert [c.noise_mg for c in noises] == sorted(c.noise_mg for c in noises)
    assert [c.delay_ms for c in noises] == sorted((c.delay_ms for c in noises), reverse=True)
    for motion_hz in (0.0, -1.0, 281.0, float("nan")):
        with pytest.raises(UsageError, match="follows"):
            bandwidth.choose(motion_hz)


def test_the_bandwidth_command_prints_the_choice_and_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    answer = said(capsys, "bandwidth", "2.5", "--table", "--seeds", "2")
    assert answer["choice"]["corner_hz"] == 3.125
    assert [row["corner_hz"] for row in answer["table"]] == [5.0, 20.0, 50.0, 350.0]
    assert front.main(["bandwidth"]) == 2

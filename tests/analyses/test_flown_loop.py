"""`plumb tune pid` of a recorded flight: the sticks are the test signal."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.analyses.identification import flown_loop, pid_tuning, plant_fit
from plumb.analyses.identification.loop_test import on_twin
from plumb.analyses.identification.pid_design import Wanted
from plumb.boards.contract import RawCounts, Setpoints
from plumb.boards.native import core as native_core
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.systems.quadrotor import scenarios
from plumb.systems.quadrotor.plant import QuadrotorPlant
from support.recordings import GAINS, log_of_counts, other_digest, recorded_run, with_frames

PERIOD_US = 5000
FLIGHT_S = 50.0
WANTED = Wanted(45.0, 8.0, 0.030)
Flight = tuple[ControlParams, RawCounts, Setpoints]


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A minute of both sticks, a new value every 0.7 s, up to 35 deg."""
    run = scenarios.scenario("sticks", 1000, period_us=PERIOD_US, seconds=FLIGHT_S)
    params = quantise(run.fit(scenarios.HUMMINGBIRD))
    plant, core = QuadrotorPlant(run), native_core.Controllers(params, 1)
    raw, setpoint = np.zeros((run.steps, 12), np.int16), np.zeros(run.steps, np.int32)
    pulses: dict[str, int] = {}
    for step in range(run.steps):
        time_s = step * PERIOD_US * 1e-6
        plant.follow(time_s, pulses)
        counts = plant.counts(time_s)
        raw[step, : len(counts)], setpoint[step] = counts, plant.setpoint(time_s)
        words = core.step(raw[step : step + 1, : len(counts)], setpoint[step : step + 1])
        pulses = {f"pulse_halfus_{rotor}": int(words[f"pulse_halfus_{rotor}"][0]) for rotor in range(4)}
    return params, raw[:, : len(counts)], setpoint


@pytest.fixture(scope="module")
def log(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    params, raw, setpoint = flight
    return log_of_counts(tmp_path_factory.mktemp("log") / "flight.plog", params, raw, setpoint=setpoint)


def test_a_flight_and_a_test_of_the_loop_give_the_same_plant(flight: Flight) -> None:
    now = pid_tuning.tune(flown_loop.flown(*flight, "roll"), WANTED, design=False)
    excited = plant_fit.excitation(PERIOD_US * 1e-6, 8.0)
    tested = plant_fit.fit(on_twin(NativeBoard(), flight[0], excited, 3, 1000, "roll").measurement()).plant
    flown = now.plant.plant
    # The rotors give more for a command while the pilot climbs: a larger gain is fitted.
    assert flown.gain_dps2 == pytest.approx(tested.gain_dps2, rel=0.12)
    assert flown.lag_s + flown.delay_s == pytest.approx(tested.lag_s + tested.delay_s, abs=0.003)
    assert now.before.phase_deg == pytest.approx(55.0, abs=6.0), "the whole loop, swept at 5 ms, has 55 deg"


def test_gains_for_a_flown_loop_have_the_margins_that_are_wanted(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = ["--phase-deg", "45", "--gain-db", "8", "--delay-ms", "30"]
    assert front.main(["tune", "pid", str(log), "--loop", "pitch", *wanted, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["met"] and report["margins"]["phase_deg"] >= 0.99 * 45.0, report["margins"]


def test_the_log_has_the_flight(log: Path, flight: Flight) -> None:
    run = flown_loop.of_log(log, None)
    assert run.raw.tolist() == flight[1].tolist() and run.setpoint.tolist() == flight[2].tolist()
    assert run.tested.signals[0] == "roll_demand", "the first axis, unless another is asked for"


def test_a_log_whose_steps_are_not_those_of_its_parameters_is_refused(flight: Flight, tmp_path: Path) -> None:
    params, raw, setpoint = flight
    short = log_of_counts(tmp_path / "short.plog", params, raw[:400], setpoint=setpoint[:400])
    bad = with_frames(short, tmp_path / "bad.plog", other_digest(25))
    with pytest.raises(UsageError, match="the board's steps are not those of its counts"):
        flown_loop.of_log(bad, None)
    changed = recorded_run(tmp_path / "changed.plog", setpoint=1 << 28, changes=[GAINS])
    with pytest.raises(UsageError, match="gains changed within the run"):
        flown_loop.of_log(changed, None)


def test_a_flight_without_sticks_is_refused(flight: Flight) -> None:
    params, raw, setpoint = flight
    still = raw.copy()
    still[:, 6:9] = 0
    with pytest.raises(UsageError, match="0 windows of 4 s in which the loop is closed and the stick"):
        flown_loop.flown(params, still, setpoint, "roll")
    with pytest.raises(UsageError, match="are too few, 20 are needed: move it for 42 s"):
        flown_loop.flown(params, raw[:6000], setpoint[:6000], "roll")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give --board native"),
        (["LOG", "--board", "native"], "with a LOG give --loop, margins and --out alone"),
        (["LOG", "--loop", "yaw"], "roll or pitch"),
        (["nothere.plog"], "No such file"),
    ],
)
def test_what_a_flight_is_not_asked(
    arguments: list[str], sentence: str, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(log) if one == "LOG" else one for one in arguments]
    assert front.main(["tune", "pid", *given]) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())

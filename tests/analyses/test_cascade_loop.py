"""Loops of a vehicle whose vertical asks for rates: found in flight, with gains that have the margins."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.analyses.identification import loop_test, pid_tuning, plant_fit, tested_loop
from plumb.analyses.identification.pid_design import Wanted
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.judging.quadrotor import loops
from plumb.judging.quadrotor.tested_loops import AxisOfVehicle
from plumb.proof import loop_figures
from plumb.systems.quadrotor import scenarios
from plumb.systems.quadrotor.reference_rates import RateLoop
from plumb.systems.quadrotor.settings import RateGains
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.tuning.cascade_model import Cascade, CascadeGains
from plumb.tuning.loop_model import nearest_margins

pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")

ASKED = Wanted(45.0, 8.0, 0.03)
PARAMS = quantise(scenarios.HUMMINGBIRD)


@pytest.fixture(scope="module")
def tested() -> loop_test.LoopRun:
    excited = plant_fit.excitation(scenarios.HUMMINGBIRD.period_s, 8.0)
    with NativeBoard() as board:
        return loop_test.on_twin(board, PARAMS, excited, 4, 1000, "pitch")


def test_the_controller_responds_as_the_reference() -> None:
    """A rate that swings, through RateLoop until its transients are gone."""
    tuning, samples, cycles = scenarios.HUMMINGBIRD, 100, 8
    rates, period_s = tuning.rates, tuning.period_s
    gains = RateGains(kp_per_dps=0.002, ki_per_deg=0.01, kd_per_dps2=3e-5)
    loop, demands = RateLoop(gains), []
    for step in range(40 * samples):
        rate = math.cos(2.0 * math.pi * step / samples)
        demands.append(loop.step(rates, period_s, 0.0, rate, flies=True, landed=False))
    found = np.fft.rfft(demands[-cycles * samples :])[cycles] / (cycles * samples / 2.0)
    hz = np.array([1.0 / (samples * period_s)])
    model, still = Cascade(period_s, rates.d_tau_s), np.zeros(1, np.complex128)
    expected = model.command(hz, still, np.ones(1, np.complex128), CascadeGains(0.002, 0.01, 3e-5, 6.0))[0]
    assert found == pytest.approx(-expected, rel=1e-3)


def test_the_test_finds_the_margins_that_a_sweep_finds(tested: loop_test.LoopRun) -> None:
    """Two ways to the same loop: stick to rate, and a sine added to the rotors (tools/gen_margins.py)."""
    before = pid_tuning.tune(tested, ASKED, design=False).before
    swept = loop_figures.identified("quadrotor")["pitch"]
    assert before.phase_deg == pytest.approx(swept.phase_deg, abs=1.0)
    assert before.crossover_hz == pytest.approx(swept.crossover_hz, rel=0.02)


def test_the_gains_have_the_margins_when_they_fly(tested: loop_test.LoopRun) -> None:
    """By a sweep in flight, which knows nothing of the model; of the loop with the vertical, and without."""
    tuning = pid_tuning.tune(tested, ASKED)
    assert not tuning.refusal() and tuning.design.rejection_db < -3.0, "better than the gains before"
    assert all(after.phase_deg > ASKED.phase_deg and after.stable for _, after in tuning.parts) and tuning.parts
    assert isinstance(tuning.tuned, QuadrotorTuning)
    flown = nearest_margins(*loops.swept("pitch", tuning.tuned, scenarios.PERIOD_US))
    assert flown.phase_deg > ASKED.phase_deg and loop_figures.gain_margin_db(flown) > ASKED.gain_db
    assert flown.delay_s > 0.98 * ASKED.delay_s  # the model's 30 ms, as the rotors are


def test_what_a_vehicle_cannot_be_asked_is_one_sentence(tested: loop_test.LoopRun) -> None:
    with pytest.raises(UsageError, match="quadrotor has no loop 'heave': give --loop roll or pitch"):
        tested_loop.loop_of(PARAMS, "heave")
    with pytest.raises(UsageError, match="quadrotor is tested in lockstep"):
        loop_test.linked_loop(PARAMS)
    loud = replace(tested, setpoint=0 * tested.setpoint)
    with pytest.raises(UsageError, match="reaches its limit"):
        loud.measurement()


def test_the_stick_is_the_lean_that_is_asked_for() -> None:
    axis = tested_loop.loop_of(PARAMS, "roll")
    assert isinstance(axis, AxisOfVehicle)
    counts, throttle = axis.inputs((0,) * 12, 9000, 8.0)
    assert counts[:6] == (0,) * 6 and counts[7:] == (0,) * 5 and throttle == 9000
    assert axis.asked_deg(np.array([counts], np.int16), np.zeros(1, np.int32))[0] == pytest.approx(8.0, abs=0.01)


@pytest.mark.slow
def test_the_command_prints_what_sets_them(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--board", "native", "--system", "quadrotor", "--periods", "3", "--phase-deg", "45", "--gain-db", "8"]
    assert front.main(["tune", "pid", *options, "--delay-ms", "30", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    names = ["rates.roll.kp_per_dps", "rates.roll.ki_per_deg", "rates.roll.kd_per_dps2", "level.gain_per_s"]
    assert list(report["settings"]) == names and report["met"] and report["warnings"] == []
    assert report["apply"][0].startswith("plumb params set rates.roll.kp_per_dps=")

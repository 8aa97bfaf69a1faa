"""Every scenario of every system has a limit of accuracy, and an estimate that is far off fails it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from plumb import systems
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.contract.scenario import fitted
from plumb.judging.angles import MAIN
from plumb.proof import invariants, limits, runs
from plumb.proof.figures import limits_of
from plumb.proof.measures import main_of
from plumb.systems.quadrotor.courses import COURSES

FAR_DEG = 93.0
GROUNDED = {("topples", "open"), ("ice-both", "open")}
"""Rides of wheels that end on the ground without a controller: no tuning has a limit there, and none is asked for."""


def kinds(name: str) -> Iterator[tuple[str, str, str, bool]]:
    """Scenario, tuning, loop, and whether it is shorter, of every run that `plumb run` can make and that no invariants
    judge; the tunings with one that no limit was measured of."""
    system = systems.load(name)
    for scenario in (one for one in system.SCENARIOS if not invariants.judges(name, one)):
        for loop in ("open", "closed") if system.OUTPUTS else ("open",):
            for tuning in (*system.TUNINGS, "own"):
                yield from ((scenario, tuning, loop, shorter) for shorter in (False, True))


def run_of(name: str) -> runs.Run:
    """A run of the default scenario and tuning on the native core."""
    system = systems.load(name)
    scenario = system.scenario(system.DEFAULT_SCENARIO, 3, seconds=12.0)
    params = quantise(fitted(scenario, system.TUNINGS[system.DEFAULT_TUNING]))
    return runs.open_loop(NativeBoard(), runs.prescribed(scenario), params)


@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_a_run_of_any_scenario_is_judged(name: str) -> None:
    for scenario, tuning, loop, shorter in kinds(name):
        own = limits_of(name, scenario, tuning, loop, shorter=shorter)
        found = limits.judged({MAIN: FAR_DEG}, own, main_of(name))
        if found.verdict is None and not shorter and (scenario, loop) in GROUNDED:
            continue
        if found.verdict is None and invariants.judges(name, scenario):
            continue
        if found.verdict is None:  # only where there is no angle to judge
            assert run_of(name).metrics()[MAIN] is None, (scenario, tuning, loop, shorter)
            return
        assert found.verdict == "fail", (scenario, tuning, loop, shorter)
        assert found.text.startswith("93 deg rms — outside the limit: at most ")


def test_a_flight_of_any_scenario_is_judged_by_what_its_pilot_asks() -> None:
    """A good estimate is not enough: the sticks that the host sent by mistake were 0 in every step."""
    for scenario, tuning, loop, shorter in kinds("quadrotor"):
        found = limits_of("quadrotor", scenario, tuning, loop, shorter=shorter)
        flown = [limit.value for limit in found if limit.metric == limits.FLOWN]
        stands = COURSES[scenario].held or (shorter and COURSES[scenario].seconds < 10.0)  # measured over 3 s then
        assert len(flown) == (loop == "closed" and not stands), (scenario, tuning, loop, shorter)
        for value in flown:
            for off, verdict in ((0.99 * value, "pass"), (1.01 * value, "fail")):
                assert limits.judged({MAIN: 0.01, limits.FLOWN: off}, found, main_of("quadrotor")).verdict == verdict


def test_a_limit_that_was_asked_for_stays() -> None:
    asked = limits_of("quad", "motion", "adaptive", "open")
    assert [(limit.metric, limit.value) for limit in asked] == [(MAIN, 0.60)]
    gain, rms = limits_of("turntable", "motion", "data", "open")[1:]
    assert (gain.metric, gain.value, rms.metric) == ("below_gyro_max_percent", 27.0, MAIN)


TURNED = {"tilt_deg", "pitch_deg"}


@pytest.mark.parametrize("name", systems.SYSTEMS)
def test_an_estimate_93_deg_off_is_bit_exact_and_not_accurate(name: str) -> None:
    """The truth is turned, the integers stay."""
    system, run = systems.load(name), run_of(name)
    heading = {"scenario": system.DEFAULT_SCENARIO, "tuning": system.DEFAULT_TUNING, "loop": "open"}
    summary, judged = run.summary(**heading), run.metrics()[MAIN] is not None
    assert (summary["verdict"], summary["bit_exact"], summary["accuracy"]) == ("pass", True, "pass" if judged else None)
    if not judged:
        return
    truth = run.inputs.truth
    turned = {key: values + FAR_DEG * (key in TURNED) for key, values in truth.items()}
    if "attitude_w" in truth:  # about the body's x
        cosine, sine = np.cos(np.radians(FAR_DEG) / 2.0), np.sin(np.radians(FAR_DEG) / 2.0)
        w, x, y, z = (truth[f"attitude_{axis}"] for axis in "wxyz")
        rotated = (cosine * w - sine * x, cosine * x + sine * w, cosine * y + sine * z, cosine * z - sine * y)
        turned |= {f"attitude_{axis}": values for axis, values in zip("wxyz", rotated, strict=True)}
    if "up_x" in truth:  # the same turn, of a vertical
        cosine, sine = np.cos(np.radians(FAR_DEG)), np.sin(np.radians(FAR_DEG))
        y, z = truth["up_y"], truth["up_z"]
        turned |= {"up_y": cosine * y - sine * z, "up_z": sine * y + cosine * z}
    wrong = replace(run, inputs=replace(run.inputs, truth=turned))
    for more in ({}, {"faults": ["stuck:gyro@1"]}, {"tuning": "own"}, {"conditions": {"lag_s": 0.0}}):
        summary = wrong.summary(**heading, **more) if "tuning" not in more else wrong.summary(**{**heading, **more})
        assert (summary["verdict"], summary["bit_exact"], summary["accuracy"]) == ("pass", True, "fail")

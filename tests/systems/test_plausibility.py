"""Plausibility of the sensors and readiness for arming: the C of firmware/core on records, and over every shipped
scenario of the systems that drive something."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.contract.scenario import tuning_for
from plumb.errors import UsageError
from plumb.spec.records import RECORDS, Words
from plumb.tuning.variances import lsb_of
from support.declared_systems import without_outputs

ACCEL, INNOVATION, RATE = 1, 2, 4
SETTLING, MOVING, CONVERGING, SETPOINT, TILTED = 1, 2, 4, 8, 16
QUAD = quantise(systems.load("quad").TUNINGS["adaptive"])
STEP_S = QUAD.period_s
DEG, DPS, G = 2**32 / 360, 2**28 / 360, 2**26
R_DEG2, K0 = 0.25, 0.03


def records(steps: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Steps of an axis at rest, level and converged."""
    rows = np.zeros(steps, RECORDS["quad"])
    rows["accel_z_g_q26"] = G
    rows["variance"] = round(R_DEG2 / lsb_of(QUAD) / 2**32)
    rows["k0_q29"] = round(K0 * 2**29)
    rows["step"] = np.arange(1, steps + 1)
    return rows


def checked(rows: np.ndarray[tuple[int], np.dtype[np.void]]) -> tuple[list[int], list[int]]:
    failed, missing = native_core.plausibility(QUAD, Words(rows))
    return failed.tolist(), missing.tolist()


def fails_after_s(rows: np.ndarray[tuple[int], np.dtype[np.void]], start: int, bit: int) -> float | None:
    """From step `start` until this check fails, and no other one does before; None: never."""
    failed, _ = checked(rows)
    assert not any(failed[:start])
    bad = [k for k, bits in enumerate(failed) if bits]
    if not bad:
        return None
    assert failed[bad[0]] == bit
    return (bad[0] - start + 1) * STEP_S


@pytest.mark.parametrize(("g", "fails"), [(0.59, True), (0.61, False), (1.39, False), (1.41, True), (0.0, True)])
def test_an_acceleration_that_the_system_cannot_have(g: float, fails: bool) -> None:
    rows = records(100)
    rows["accel_z_g_q26"][50:] = round(g * G)
    found = fails_after_s(rows, 50, ACCEL)
    assert found == pytest.approx(0.2) if fails else found is None


def test_a_knock_is_not_enough() -> None:
    """0.18 s of it; and a sample between does not begin the count anew."""
    rows = records(120)
    rows["accel_z_g_q26"][50:59] = 2 * G
    assert fails_after_s(rows, 50, ACCEL) is None
    rows["accel_z_g_q26"][50:64] = 2 * G
    rows["accel_z_g_q26"][55] = G
    assert fails_after_s(rows, 50, ACCEL) == pytest.approx(0.24)


@pytest.mark.parametrize("r_deg2", [0.25, 4.0, 9.0, 100.0])
@pytest.mark.parametrize("k0", [0.001, 0.03, 0.5])
def test_the_innovation_is_held_to_15_deg_and_6_sigma(r_deg2: float, k0: float) -> None:
    """sigma^2 = R / (1 - k0), from the words of the step and the unit of variance alone. A gain of more than 2 a second
    hides an innovation soon: its time counts fourfold."""
    time_s = 0.3 if k0 <= 2.0 * STEP_S else 4 * STEP_S
    limit_deg = max(15.0, 6.0 * math.sqrt(r_deg2 / (1.0 - k0)))
    for innovation_deg, fails in ((0.995 * limit_deg, False), (1.005 * limit_deg, True)):
        rows = records(100)
        rows["variance"][50:] = round(r_deg2 / lsb_of(QUAD) / 2**32)
        rows["k0_q29"][50:] = round(k0 * 2**29)
        rows["innovation_turn_q32"][50:] = np.int64(innovation_deg * DEG) * np.resize([1, -1], 50)
        found = fails_after_s(rows, 50, INNOVATION)
        assert found == pytest.approx(time_s) if fails else found is None


def test_before_it_converged_the_innovation_says_nothing() -> None:
    rows = records(100)
    rows["innovation_turn_q32"] = round(20 * DEG)
    failed, missing = checked(rows)
    assert not any(failed)
    assert missing[-1] & CONVERGING


@pytest.mark.parametrize("sign", [1, -1])
def test_gyro_and_tilt_turn_together(sign: int) -> None:
    """A gyro that reads 55 deg/s at rest passes, as a bias may be; 120 and 300 deg/s do not."""
    for rate_dps, longest_s in ((55.0, None), (120.0, 0.34), (300.0, 0.22)):
        rows = records(150)
        rows["rate_turnps_q28"][50:] = round(sign * rate_dps * DPS)
        found = fails_after_s(rows, 50, RATE)
        assert found is None if longest_s is None else found is not None and 0.12 <= found <= longest_s
    rows = records(150)
    turned = np.cumsum(np.r_[np.zeros(50), np.full(100, 200.0 * STEP_S)])
    rows["rate_turnps_q28"][50:] = round(sign * 200.0 * DPS)
    rows["tilt_measured_turn_q32"] = (np.int64(sign * turned * DEG) + 2**31) % 2**32 - 2**31
    assert fails_after_s(rows, 50, RATE) is None, "both turn at 200 deg/s, through half a turn"


def test_what_is_missing_before_arming() -> None:
    """0.3 s with a small innovation, then 0.3 s with nothing missing."""
    rows = records(100)
    failed, missing = checked(rows)
    assert not any(failed)
    converged = [bool(bits & CONVERGING) for bits in missing].index(False)
    assert (converged + 1) * STEP_S == pytest.approx(0.3, abs=1.5 * STEP_S)
    assert (missing.index(0) - converged) * STEP_S == pytest.approx(0.3, abs=1.5 * STEP_S)
    assert not any(missing[missing.index(0) :])
    for name, value, bit in (
        ("setpoint_turn_q32", 1, SETPOINT),
        ("tilt_turn_q32", round(-15.1 * DEG), TILTED),
        ("rate_corrected_turnps_q28", round(-8 * DPS), MOVING),
        ("innovation_turn_q32", round(5 * DEG), CONVERGING),
        ("accel_z_g_q26", round(1.2 * G), MOVING),
        ("accel_z_g_q26", round(0.8 * G), MOVING),
    ):
        rows = records(160)
        rows[name][60:90] = value
        _, missing = checked(rows)
        assert missing[59] == 0
        assert missing[89] == bit | SETTLING, name
        assert missing[-1] == 0, name


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "tools/check_plausibility.py"
    spec = importlib.util.spec_from_file_location("check_plausibility", path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["check_plausibility"] = module
    spec.loader.exec_module(module)
    return module


CASES = [
    (name, scenario, loop)
    for name in ("quad", "balancer")
    for scenario in systems.load(name).SCENARIOS
    for loop in ("open", "closed")
] + [("quad", "hold", "pushed"), ("balancer", "rough", "pushed")]


@pytest.mark.slow
@pytest.mark.parametrize(("system", "scenario", "loop"), CASES)
def test_no_shipped_scenario_disarms(tool: ModuleType, system: str, scenario: str, loop: str) -> None:
    """20 seeds of 15 to 50 s; tools/check_plausibility.py does 200 of the whole length."""
    own = systems.load(system)
    params = quantise(own.TUNINGS[tuning_for(own, scenario)])
    seconds = {"pushed": 22.0 if system == "quad" else 42.0}.get(loop, 15.0)
    seeds = range(2000, 2020 if loop == "open" else 2005 if loop == "pushed" else 2010)
    for seed in seeds:
        found = tool.outcome(params, tool.words_of(system, scenario, seed, params, loop, seconds))
        assert found.failed_step is None, (seed, found)
        if scenario == "converge":  # held 30 deg off
            assert found.ready_step is None
        else:
            assert found.ready_step is not None and found.ready_step * params.period_s < 1.0, (seed, found)


@pytest.mark.parametrize("tuning", ["hold", "adaptive"])
def test_noise_on_an_axis_is_noticed_in_every_draw(tuning: str) -> None:
    """0.5 V rms (0.6 g) on accelerometer y at 5 and 20 ms, 40 draws; 480 ms leave 20 for a turn and a pulse."""
    params, own = quantise(systems.load("quad").TUNINGS[tuning]), systems.load("quad")
    period_us = round(params.period_s * 1e6)
    begin = 2_000_000 // period_us
    for seed in range(40):
        scenario = own.scenario("quiet", seed, seconds=3.0, period_us=period_us, faults=())
        counts = scenario.counts().copy()
        noise = np.random.default_rng(seed + 99).normal(0.0, 0.5 / 3.3 * 4096, len(counts) - begin)
        counts[begin:, 1] = np.clip(counts[begin:, 1] + np.rint(noise), 0, 4095)
        failed, _ = native_core.plausibility(params, native_core.run_control(params, counts, scenario.setpoint()))
        assert not failed[:begin].any()
        assert failed[begin:].any(), seed
        assert (int(np.flatnonzero(failed[begin:])[0]) + 1) * period_us <= 480_000, seed


@pytest.mark.parametrize("tuning", ["hold", "adaptive"])
def test_an_accelerometer_that_turns_is_noticed_whenever_it_turns(tuning: str) -> None:
    """By 28 deg, from the first step that may be armed on; 20 moments of the first 3 s at 5 and 20 ms."""
    params, own = quantise(systems.load("quad").TUNINGS[tuning]), systems.load("quad")
    period_us = round(params.period_s * 1e6)
    scenario = own.scenario("quiet", 7, seconds=4.0, period_us=period_us, faults=())
    _, missing = native_core.plausibility(
        params, native_core.run_control(params, scenario.counts(), scenario.setpoint())
    )
    ready = int(np.flatnonzero(missing == 0)[0])
    cosine, sine = math.cos(math.radians(28.0)), math.sin(math.radians(28.0))
    for begin in np.linspace(ready, 3_000_000 // period_us, 20).astype(int):
        counts = scenario.counts().copy()
        y, z = counts[begin:, 1] - 2048.0, counts[begin:, 2] - 2048.0
        counts[begin:, 1] = np.rint(2048.0 + cosine * y + sine * z)
        counts[begin:, 2] = np.rint(2048.0 + cosine * z - sine * y)
        failed, _ = native_core.plausibility(params, native_core.run_control(params, counts, scenario.setpoint()))
        assert not failed[:begin].any()
        assert failed[begin:].any() and (int(np.flatnonzero(failed[begin:])[0]) + 1) * period_us <= 320_000, begin


@pytest.mark.parametrize("system", without_outputs())
def test_of_what_moves_nothing_nothing_is_checked(system: str) -> None:
    own = systems.load(system)
    params = quantise(own.TUNINGS[own.DEFAULT_TUNING])
    with pytest.raises(UsageError, match="no plausibility is checked"):
        native_core.plausibility(params, Words(np.zeros(3, RECORDS[system])))

"""A gyro of `wheels` that is held away from the truth, at drawn moments on drawn rides, with the C integers in
the loop: it is noticed, or the vehicle has stopped, within the time that the fault table gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract.parameters import quantise
from plumb.proof.faults.limits import limits
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.records import RECORDS, Words
from plumb.systems.wheels import fixed_state, scenarios
from plumb.systems.wheels.plant import WheelsPlant

RATE, FULL, GYRO_LSB_PER_DPS, GYRO_NOISE_DPS = 4, 32768.0, 16.4, 0.5
LEAST_DPS, MOST_DPS = 80.0, 400.0
"""Offsets: 60 deg/s are just within the check's bound; at 400 the estimate has fallen after 0.12 s."""
PUT_MS = 5.0
"""From a step to the pins."""


def ridden(seed: int, offset_dps: float, at_s: float, seconds: float) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Time, whether the rates are told to differ, and whether it has stopped as fallen, (steps,) each. From at_s on the
    gyro keeps the rate of that moment and the offset, with noise."""
    rng = np.random.default_rng(seed)
    names = ("level", "slope", "turns", "shifted")
    drawn = scenarios.scenario(str(rng.choice(names)), seed)
    run, params = replace(drawn, faults=()), quantise(scenarios.STEERED)
    plant, core = WheelsPlant(run), native_core.Controller(params)
    time_s = run.time_s[run.time_s < seconds]
    rows, held = [], 0.0
    duties: tuple[float | None, float | None] = (None, None)
    for now_s in time_s.tolist():
        plant.drive_to(now_s, duties)
        raw = list(plant.counts(now_s))
        if now_s < at_s:
            held = raw[0] / GYRO_LSB_PER_DPS + offset_dps
        elif offset_dps:
            raw[0] = round((held + rng.normal(0.0, GYRO_NOISE_DPS)) * GYRO_LSB_PER_DPS)
        words = core.step(raw, plant.setpoint(now_s))
        duties = (words["duty_left_q15"] / FULL, words["duty_right_q15"] / FULL)
        rows.append(tuple(words.values()))
    records = Words(np.array(rows, RECORDS["wheels"]))
    failed, _ = native_core.plausibility(params, records)
    return time_s, (failed & RATE) != 0, (records["stop_reason"] & fixed_state.STOP_FALLEN) != 0


@pytest.mark.parametrize("sign", [1, -1])
def test_a_gyro_that_is_held_off_is_noticed_in_its_time(sign: int) -> None:
    """Seen or stopped; the check speaks first wherever the estimate has not fallen before."""
    within_s = (limits()["rate"].safe_ms - PUT_MS) * 1e-3
    spoke = 0
    for seed in range(10):
        rng = np.random.default_rng(7000 + 2 * seed + (sign > 0))
        offset_dps, at_s = sign * float(rng.uniform(LEAST_DPS, MOST_DPS)), float(rng.uniform(2.5, 6.0))
        time_s, told, fallen = ridden(seed, offset_dps, at_s, at_s + within_s)
        after = time_s >= at_s
        assert not told[~after].any()
        assert (told | fallen)[after].any(), (seed, offset_dps, at_s)
        spoke += int(told[after].any())
    assert spoke >= 3


def test_no_ride_with_an_honest_gyro_is_stopped_for_it() -> None:
    for seed in range(8):
        _, told, _ = ridden(seed, 0.0, np.inf, 9.0)
        assert not told.any(), seed

"""The invariants of `quadrotor`: a good flight keeps them all, and each is broken by what it forbids."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from plumb.campaign import batch
from plumb.campaign.study import from_table
from plumb.judging.quadrotor import invariants
from plumb.proof.runs import Run
from plumb.spec.records import Words
from plumb.systems.quadrotor import fixed_phase
from plumb.systems.quadrotor.drawn_run import GYRO_LIES
from plumb.systems.quadrotor.fixed import AIRBORNE

Array = npt.NDArray[np.integer[Any]]
Word = int | Callable[[Array], Array]
FROM_S = 20.0


def flown(scenario: str, seed: int) -> Run:
    table = {"system": "quadrotor", "scenario": scenario, "seconds": 30, "runs": 40, "first_seed": seed}
    return batch.run_one(from_table(table).request(0))


@cache
def good(scenario: str) -> Run:
    return flown(scenario, 1000)


def changed(run: Run, words: Mapping[str, Word], truth: Mapping[str, float], switch: int | None = None) -> Run:
    """The run with other words and another truth from FROM_S on."""
    late = run.inputs.time_s >= FROM_S
    record, raw = run.words.record.copy(), run.inputs.raw.copy()
    for name, value in words.items():
        record[name][late] = value(record[name][late]) if callable(value) else value
    known = {name: values.copy() for name, values in run.inputs.truth.items()}
    for column, number in truth.items():
        known[column][late] = number
    if switch is not None:
        raw[late, invariants.SWITCHES] = switch
    other = Words(record)
    return replace(
        run, words=other, answer=replace(run.answer, words=other), inputs=replace(run.inputs, truth=known, raw=raw)
    )


def flagged(bit: int) -> Callable[[Array], Array]:
    return lambda flags: flags | bit


def without(bit: int) -> Callable[[Array], Array]:
    return lambda flags: flags & ~np.array(bit, flags.dtype)


STOPS: dict[str, Word] = {"phase": invariants.STOPPED}
LEANS = {"lean_deg": 41.0}
BROKEN: dict[str, tuple[str, dict[str, Word], dict[str, float], int | None]] = {
    "idle in the air": ("stops", {**STOPS, "stop_reason": fixed_phase.IDLE}, {}, None),
    "a rotor at 0": ("stops", {"rotor_q24_2": 0}, {}, None),
    "a runaway that is none": ("good-flight", {**STOPS, "stop_reason": fixed_phase.RUNAWAY}, {}, None),
    "a lean that nobody asked for": ("tilt", {}, LEANS, None),
    "a lean while it is unsure": ("calm", {"flags": flagged(invariants.UNSURE)}, LEANS, None),
    "too sure": ("sigma", {"tilt_variance_rad2_q32": 1}, {}, None),
    "rotors without a switch": ("unasked", {}, {}, 0),
}


@pytest.mark.parametrize("name", BROKEN)
def test_each_is_broken_by_what_it_forbids(name: str) -> None:
    invariant, words, truth, switch = BROKEN[name]
    found = invariants.violations(changed(good("calm"), words, truth, switch))
    assert {one.invariant for one in found} == {invariant}
    assert FROM_S - 1e-6 <= min(one.time_s for one in found) < FROM_S + 3.0


def test_a_vehicle_that_lies_still_has_to_be_known_as_landed() -> None:
    still = {"pressed": 1.0, "speed_mps": 0.0, "clear_m": 0.0, "rate_x_dps": 0.0, "rate_y_dps": 0.0, "rate_z_dps": 0.0}
    run = good("calm")
    low = replace(run, inputs=replace(run.inputs, setpoint=np.where(run.inputs.time_s >= FROM_S, 0, 9000)))
    forgotten = invariants.violations(changed(low, {"flags": flagged(AIRBORNE)}, still))
    assert [one.invariant for one in forgotten] == ["landed"]
    assert forgotten[0].time_s == pytest.approx(FROM_S + invariants.LIES_STILL_S, abs=0.01)
    assert not invariants.violations(changed(low, {"flags": without(AIRBORNE)}, still))


def test_a_sensor_that_lies_excuses_all_but_the_switch() -> None:
    lies = {"happening": float(GYRO_LIES)}
    for name, (invariant, words, truth, switch) in BROKEN.items():
        run = changed(good("calm"), words, {**truth, **lies}, switch)
        found = {one.invariant for one in invariants.violations(run)}
        assert found == ({"unasked"} if invariant == "unasked" else set()), name


def test_a_good_flight_keeps_them_all() -> None:
    assert not invariants.violations(good("calm"))
    assert not invariants.violations(good("take-off"))


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(103021, id="cut 0.2 s after the take-off, in wind: no runaway"),
        pytest.param(24935, id="an accelerometer at its limit teaches no hover: not landed in the air"),
    ],
)
def test_flights_that_once_broke_one(seed: int) -> None:
    assert not invariants.violations(flown("random", seed))


def test_the_largest_of_the_last_steps() -> None:
    values = np.random.default_rng(1).standard_normal(50)
    for steps in (0, 1, 2, 3, 7, 12):
        expected = [values[max(place - steps, 0) : place + 1].max() for place in range(50)]
        assert invariants._most(values, steps).tolist() == expected

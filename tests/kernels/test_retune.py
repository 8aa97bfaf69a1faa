"""Other gains in the middle of a run: the same state in C and in the model, and no jump of the demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.step import FIXED, RetunedStep
from plumb.kernels.fixed.kernels import PidState, pid_direct, pid_retune
from plumb.spec import declarations, parameters
from plumb.spec.records import RECORDS
from plumb.systems import load
from support.wild_params import wild_balancer_params, wild_params

LIVE = [row for row in parameters.table() if row.live]
RETUNED = [
    name
    for name, system in declarations.systems().items()
    if {row.group for row in LIVE} & set(system.all_groups) and name in RECORDS
]
WILD: Mapping[str, Callable[[np.random.Generator], ControlParams]] = {
    "quad": wild_params,
    "balancer": wild_balancer_params,
}
WORDS = ("integral_q54", "command_q22", "rate_filtered_turnps_q27", "excess_q22", "error_turn_q32")


def with_gains_of(params: ControlParams, other: ControlParams) -> ControlParams:
    """The same parameters with the other's live ones."""
    return ControlParams({**params.values, **{row.name: other[row.name] for row in LIVE}})


def wild_states(rng: np.random.Generator, n: int) -> np.ndarray:
    states = np.zeros(n, native_core.PID_DTYPE)
    states["integral_q54"] = rng.integers(-(1 << 55), 1 << 55, n) >> rng.integers(0, 54, n)
    for name in ("rate_filtered_turnps_q27", "error_turn_q32"):
        states[name] = rng.integers(-(1 << 31), 1 << 31, n) >> rng.integers(0, 31, n)
        states[name][:4] = (-(1 << 31), (1 << 31) - 1, -1, 0)
    return states


def test_the_systems_with_live_parameters_say_how_they_take_them() -> None:
    assert [*WILD, "wheels"] == RETUNED, "whose golden vector wheels_retune changes its gains with its rider on it"
    assert [name for name in RECORDS if isinstance(load(name, FIXED), RetunedStep)] == RETUNED


def test_retuning_any_state_is_the_same_in_c_and_in_the_model() -> None:
    rng = np.random.default_rng(50)
    for _ in range(100):
        old = wild_params(rng)
        new = with_gains_of(old, wild_params(rng))
        states = wild_states(rng, 1000)
        for state, after in zip(states.tolist(), native_core.pid_retune(old, new, states).tolist(), strict=True):
            model = PidState(*state)
            pid_retune(model, old.values, new.values)
            assert model.words() == after


def test_the_demand_of_the_last_error_and_rate_stays_to_the_last_bit() -> None:
    rng, limit = np.random.default_rng(51), 1 << 23
    stayed = 0
    for _ in range(100):
        old = wild_params(rng)
        new = with_gains_of(old, wild_params(rng))
        for state in wild_states(rng, 1000).tolist():
            model = PidState(*state)
            before = pid_direct(model, old.values, "pid") + (model.integral_q54 >> 32)
            pid_retune(model, old.values, new.values)
            high = model.integral_q54 >> 32
            demand = pid_direct(model, new.values, "pid") + high
            if new["pid.ki_dt_q22"] == 0:
                continue
            assert -limit <= high < limit
            if -limit < high < limit - 1:
                assert demand == before
                stayed += 1
    # Of 100,000 drawn states a fifth at least is away from the limits: the claim is tried.
    assert stayed > 20_000


@pytest.mark.parametrize("system", WILD)
def test_a_run_with_changes_of_its_gains_equals_the_model_in_every_step(system: str) -> None:
    rng = np.random.default_rng(52)
    for _ in range(6):
        params = WILD[system](rng)
        core, model, still = native_core.Controller(params), run_fixed.Controller(params), run_fixed.Controller(params)
        changed_at, differed = int(rng.integers(1, 60)), False
        for step in range(120):
            raw = [int(count) for count in rng.integers(-32768, 32768, 6) >> int(rng.integers(0, 12))]
            if step == changed_at:
                params = with_gains_of(params, WILD[system](rng))
                core.retune(params)
                model.retune(params)
                changed_at += int(rng.integers(1, 40))
                differed = True
            core.step(raw, step << 18)
            model.step(raw, step << 18)
            still.step(raw, step << 18)
            assert core.digest() == model.digest(), step
        assert differed and model.digest() != still.digest()


def test_a_system_without_live_parameters_goes_on_as_it_was() -> None:
    scenarios = load(next(name for name in declarations.names() if name not in RETUNED))
    params = quantise(scenarios.TUNINGS[scenarios.DEFAULT_TUNING])
    model, other = run_fixed.Controller(params), run_fixed.Controller(params)
    for step in range(20):
        if step == 10:
            model.retune(params)
        assert model.step((step, -step, 16384, 3, 2, 1), 0) == other.step((step, -step, 16384, 3, 2, 1), 0)

"""Vectors of `wild = "reach"`: parameters that the core takes, and the same record in the model and in C."""

from __future__ import annotations

from dataclasses import replace

import pytest

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof.compare import first_divergence
from plumb.proof.golden_random import Draw
from plumb.proof.golden_reach import reach
from plumb.spec import declarations, parameters
from support.campaigns import campaign

SYSTEMS = tuple(systems.SYSTEMS)


def tuned(system: str, number: int) -> ControlParams:
    tunings = systems.load(system).TUNINGS
    return quantise(tunings[list(tunings)[number % len(tunings)]])


@pytest.mark.parametrize("system", SYSTEMS)
def test_what_is_reached_is_the_same_in_the_model_and_in_c(system: str) -> None:
    moved = 0
    for seed in range(campaign(20, 400)):
        before = tuned(system, seed)
        params, raw, setpoint = reach(before, seed, 60)
        assert native_core.params_valid(params), seed
        moved += params.own() != before.own()
        core = native_core.run_control(params, raw, setpoint)
        assert first_divergence(run_fixed.run_control(params, raw, setpoint), core) is None, seed
    assert moved > 5


def test_parameters_that_are_kept_stay() -> None:
    before = tuned("quad", 0)
    for seed in range(40):
        params, _, _ = reach(before, seed, 1, frozenset(["gyro.gain", "tilt.mode"]))
        assert all(params[name] == before[name] for name in ("gyro.gain", "tilt.mode"))


@pytest.mark.parametrize("system", SYSTEMS)
def test_model_and_core_refuse_the_same_words(system: str) -> None:
    """One or two words of a valid set at an end of their range, next to it, or any 32 bits."""
    groups = declarations.system(system).all_groups
    rows = [row for row in parameters.table() if row.owner == "control" and row.group in groups]
    draw, verdicts = Draw(7), []
    for number in range(campaign(1500, 20000)):
        params = tuned(system, number)
        for _ in range(1 + draw.below(2)):
            row = draw.of(rows)
            low, high = (-(1 << 31), (1 << 31) - 1) if row.type == "int32" else (0, (1 << 32) - 1)
            value = draw.of(
                (row.min, row.max, row.min - 1, row.max + 1, low + draw.below(1 << 32), draw.below(1 << 16))
            )
            params = replace(params, values={**params.values, row.name: min(max(value, low), high)})
        verdicts.append(native_core.params_valid(params))
        assert run_fixed.params_valid(params) == verdicts[-1], {row.name: params[row.name] for row in rows}
    assert 0.1 < sum(verdicts) / len(verdicts) < 0.9
